//! The distributed directory of the C++ `fipa_services`, as it stands in DNS-SD: one service
//! instance per agent, with the directory entry in its TXT record.
//!
//! **Knows** the names, the TXT strings, what of them is in a packet, when to ask for more, and
//! whom to answer.
//! **Never knows** a socket or a clock: packets and times come in as arguments, packets and events
//! come out as values.
pub(crate) mod answer;
pub(crate) mod browser;
pub(crate) mod packet;
pub(crate) mod reach;
pub(crate) mod responder;
pub(crate) mod timestamp;
pub(crate) mod txt;

/// The service that C++ robots use unless told otherwise, and the protocol of it.
const DEFAULT_SERVICE: (&str, &str) = ("_fipa_service_directory", "_udp");
/// The service under which daemons announce themselves.
const OWN_SERVICE: (&str, &str) = ("_fipa", "_tcp");
/// The longest service name that is announced, the underscore aside.
const LONGEST_SERVICE: usize = 30;
/// The longest label of DNS (RFC 1035 2.3.4).
const LONGEST_LABEL: usize = 63;

/// A DNS-SD service type (RFC 6763 section 7) in the domain `local`, in lower case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ServiceType {
    service: String,
    protocol: &'static str,
}

impl ServiceType {
    /// The type by which agents of a scope are announced, if the scope makes one.
    ///
    /// To `fipa_services` the scope is the service type. So a scope `_NAME._udp` is taken by its
    /// word, a scope NAME is `_NAME._udp`, and daemons without a scope meet C++ robots without one.
    pub(crate) fn of_scope(scope: &str) -> Option<ServiceType> {
        let scope = scope.to_ascii_lowercase();
        let (service, protocol) = match scope.rsplit_once('.') {
            None if scope.is_empty() => return ServiceType::checked(DEFAULT_SERVICE),
            None => (format!("_{scope}"), "_udp"),
            Some((service, "_udp")) => (service.to_owned(), "_udp"),
            Some((service, "_tcp")) => (service.to_owned(), "_tcp"),
            Some(_) => return None,
        };
        ServiceType::checked((&service, protocol))
    }

    /// The type, if its name is one of RFC 6335 section 5.1, save for its length and underscores,
    /// which the C++ library has in its own.
    fn checked((service, protocol): (&str, &'static str)) -> Option<ServiceType> {
        let name = service.strip_prefix('_')?;
        let fits = name.len() <= LONGEST_SERVICE;
        let letters = name.contains(|c: char| c.is_ascii_lowercase());
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        let hyphens = name.starts_with('-') || name.ends_with('-') || name.contains("--");
        let ours = (service, protocol) == OWN_SERVICE;
        (fits && letters && name.chars().all(plain) && !hyphens && !ours).then(|| ServiceType {
            service: service.to_owned(),
            protocol,
        })
    }

    /// The labels of the type, its domain included.
    fn labels(&self) -> [&str; 3] {
        [&self.service, self.protocol, "local"]
    }

    /// The type as text: `_fipa_service_directory._udp.local.`.
    pub(crate) fn domain(&self) -> String {
        format!("{}.{}.local.", self.service, self.protocol)
    }
}

/// The instance label of an agent: its name with `?` for every `.`, which as a regular expression
/// matches the name. `None` if there is no such label.
pub(crate) fn label(name: &str) -> Option<String> {
    let label = name.replace('.', "?");
    (1..=LONGEST_LABEL).contains(&label.len()).then_some(label)
}

/// The name that a label is read as.
fn name_of(label: &str) -> String {
    label.replace('?', ".")
}

/// What makes labels the same to DNS.
pub(crate) fn key(label: &str) -> String {
    // DNS demands that for the letters of ASCII; some libraries do it with all of them.
    label.to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domain(scope: &str) -> Option<String> {
        ServiceType::of_scope(scope).map(|service| service.domain())
    }

    #[test]
    fn a_scope_is_a_service_type() {
        for (scope, expected) in [
            ("", "_fipa_service_directory._udp.local."),
            ("plant-7", "_plant-7._udp.local."),
            ("Plant", "_plant._udp.local."),
            ("_fleet._udp", "_fleet._udp.local."),
            ("_fleet._tcp", "_fleet._tcp.local."),
            (
                "_fipa_service_directory._udp",
                "_fipa_service_directory._udp.local.",
            ),
            (
                "abcdefghijklmnopqrstuvwxyz0123",
                "_abcdefghijklmnopqrstuvwxyz0123._udp.local.",
            ),
        ] {
            assert_eq!(domain(scope).as_deref(), Some(expected), "{scope}");
        }
    }

    #[test]
    fn a_scope_that_is_no_label_has_no_service_type() {
        for scope in [
            "plant 7",
            "größe",
            "-plant",
            "plant-",
            "a--b",
            "7",
            "a.b",
            "fleet._udp",
            "_._udp",
            "._udp",
            "_fipa._tcp",
            "abcdefghijklmnopqrstuvwxyz01234",
        ] {
            assert_eq!(domain(scope), None, "{scope}");
        }
    }

    #[test]
    fn labels_have_question_marks_for_dots_and_at_most_63_octets() {
        let name = "da0@192.168.0.1:1099/JADE";
        assert_eq!(label(name).as_deref(), Some("da0@192?168?0?1:1099/JADE"));
        assert_eq!(name_of("da0@192?168?0?1:1099/JADE"), name);
        assert!(label(&"ä".repeat(31)).is_some());
        assert_eq!(label(&"ä".repeat(32)), None);
        assert_eq!(label(""), None);
    }
}
