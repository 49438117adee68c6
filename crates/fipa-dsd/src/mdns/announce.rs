//! What a daemon announces of itself.
use fipa_directory::InstanceId;
use mdns_sd::{IfKind, IfPredicate, ServiceInfo};

use super::{refused, txt};
use crate::interface::Rule;
use crate::{MdnsConfig, MdnsError};

/// The service type of the daemons. Lower case: `mdns-sd` compares types letter by letter.
pub(super) const SERVICE_TYPE: &str = "_fipa._tcp.local.";

/// The announcement that `config` asks for, with the addresses that `rule` allows.
pub(super) fn announcement(config: &MdnsConfig, rule: &Rule) -> Result<ServiceInfo, MdnsError> {
    let most = txt::room(txt::SCOPE);
    let length = config.scope.len();
    if length > most {
        return Err(MdnsError::ScopeTooLong { length, most });
    }
    let id = config.instance.to_string();
    let quic = config.quic.map(|port| port.to_string());
    let mut properties = vec![
        (txt::ID, id.as_str()),
        (txt::NAME, cut(&config.name, txt::room(txt::NAME))),
        (txt::SCOPE, config.scope.as_str()),
        (txt::VERSION, txt::CURRENT_VERSION),
    ];
    properties.extend(quic.as_deref().map(|port| (txt::QUIC, port)));
    // Services that share a host name are reported as removed together, hence our own host name.
    let host = format!("fipa-{}.local.", &id[..16]);
    let service = ServiceInfo::new(
        SERVICE_TYPE,
        &label(&config.name, config.instance),
        &host,
        rule.explicit_addresses().as_slice(),
        rule.port(),
        properties.as_slice(),
    );
    let mut service = service.map_err(refused)?.enable_addr_auto();
    // Labels and host names hold part of a random id: nothing to probe for, and three quarters of
    // a second saved.
    service.set_requires_probe(false);
    let rule = rule.clone();
    let announced = IfPredicate::new(move |interface| rule.announces(interface));
    service.set_interfaces(vec![IfKind::Predicate(announced)]);
    Ok(service)
}

/// A readable label that no other instance has.
///
/// It is lower case because `mdns-sd` does not find a service again for its second announcement
/// when the name holds a capital letter, and without dots because it takes those for separators.
fn label(name: &str, instance: InstanceId) -> String {
    let plain = name.chars().map(|c| match c {
        'a'..='z' | '0'..='9' | '_' | '-' => c,
        'A'..='Z' => c.to_ascii_lowercase(),
        _ => '-',
    });
    let readable: String = plain.take(50).collect();
    let readable = if readable.is_empty() {
        "fipa".to_owned()
    } else {
        readable
    };
    format!("{readable}-{}", &instance.to_string()[..8])
}

/// The longest beginning of `text` that has at most `most` bytes.
fn cut(text: &str, most: usize) -> &str {
    &text[..text.floor_char_boundary(most)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(name: &str, scope: &str) -> MdnsConfig {
        MdnsConfig {
            instance: InstanceId::from_bytes([0xab; 16]),
            name: name.to_owned(),
            scope: scope.to_owned(),
            endpoints: vec!["127.0.0.5:7000".parse().unwrap()],
            quic: None,
            interfaces: Vec::new(),
            agents: crate::DEFAULT_AGENTS,
            port: 5353,
        }
    }

    fn announced(config: &MdnsConfig) -> Result<ServiceInfo, MdnsError> {
        announcement(config, &Rule::new(config, &[]).unwrap())
    }

    #[test]
    fn labels_are_readable_and_short() {
        let id = InstanceId::from_bytes([0xab; 16]);
        assert_eq!(label("Arm_1-left", id), "arm_1-left-abababab");
        assert_eq!(label("größe.1 b", id), "gr--e-1-b-abababab");
        assert_eq!(label("", id), "fipa-abababab");
        assert_eq!(label(&"ü".repeat(300), id).len(), 59);
    }

    #[test]
    fn names_are_cut_between_characters() {
        assert_eq!(cut("größe", 3), "gr");
        assert_eq!(cut("größe", 4), "grö");
        assert_eq!(cut("abc", 250), "abc");
    }

    #[test]
    fn the_announcement_holds_what_others_need() {
        let service = announced(&config("Arm 1", "plant")).unwrap();
        assert_eq!(service.get_fullname(), "arm-1-abababab._fipa._tcp.local.");
        assert_eq!(service.get_hostname(), "fipa-abababababababab.local.");
        assert_eq!(service.get_port(), 7000);
        assert_eq!(
            service.get_property_val_str("id"),
            Some("ab".repeat(16).as_str())
        );
        assert_eq!(service.get_property_val_str("name"), Some("Arm 1"));
        assert_eq!(service.get_property_val_str("scope"), Some("plant"));
        assert_eq!(service.get_property_val_str("v"), Some("1"));
        let addresses: Vec<_> = service
            .get_addresses()
            .iter()
            .map(ToString::to_string)
            .collect();
        assert_eq!(addresses, ["127.0.0.5"]);
    }

    #[test]
    fn a_long_name_is_cut_and_a_long_scope_refused() {
        let service = announced(&config(&"é".repeat(200), "")).unwrap();
        assert_eq!(
            service.get_property_val_str("name"),
            Some("é".repeat(125).as_str())
        );
        assert!(announced(&config("a", &"s".repeat(249))).is_ok());
        let error = announced(&config("a", &"s".repeat(250))).unwrap_err();
        assert!(
            matches!(
                error,
                MdnsError::ScopeTooLong {
                    length: 250,
                    most: 249
                }
            ),
            "{error}"
        );
    }
}
