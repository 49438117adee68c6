//! The protocols that come with the crate.

use std::collections::BTreeSet;
use std::path::Path;

use fipa_protocol::{Library, Limits, Outcome, builtin, canonical_name, load};

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../protocols")
}

#[test]
fn every_file_is_without_a_warning_and_can_be_looked_up() {
    let mut files = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        let file = path.file_name().unwrap().to_str().unwrap();
        let loaded = load(file, &std::fs::read(&path).unwrap(), &Limits::default()).unwrap();
        assert_eq!(loaded.diagnostics, [], "{file}");
        let protocol = loaded.protocol.unwrap();
        let found = builtin(protocol.name()).unwrap();
        assert_eq!(found.name(), protocol.name());
        assert_eq!(found.states().count(), protocol.states().count());
        files += 1;
    }
    assert_eq!(Library::builtin().protocols().len(), files);
}

#[test]
fn every_name_by_which_peers_know_a_protocol_finds_it() {
    for (name, known) in [
        ("fipa-request", "request FIPA-Request fipa_request Request"),
        ("fipa-query", "query"),
        ("fipa-request-when", "request-when requestWhen"),
        ("fipa-request-whenever", "request-whenever"),
        (
            "fipa-contract-net",
            "contractNet contract-net fipa-contract-net",
        ),
        ("fipa-iterated-contract-net", "iteratedContractNet"),
        (
            "fipa-auction-english",
            "english-auction englishAuction fipa-auction-english",
        ),
        ("fipa-auction-dutch", "dutchAuction dutch-auction"),
        ("fipa-brokering", "brokering"),
        ("fipa-recruiting", "recruiting"),
        ("fipa-subscribe", "subscribe"),
        ("fipa-propose", "propose"),
        ("fipa-cancel", "cancel"),
        ("fipa-inform", "inform"),
        ("dlm_discover", "dlm_discover"),
        ("dlm_list", "dlm_list"),
        ("dlm_probe", "dlm_probe"),
        ("ricart_agrawala", "ricart_agrawala ricart-agrawala"),
        ("ricart_agrawala_extended", "ricart_agrawala_extended"),
        ("suzuki_kasami", "suzuki_kasami"),
        (
            "suzuki_kasami_extended",
            "suzuki_kasami_extended suzuki-kasami-extended",
        ),
    ] {
        for known in known.split(' ') {
            assert_eq!(builtin(known).unwrap().name(), name, "{known}");
        }
    }
    assert!(builtin("fipa").is_none() && builtin("").is_none());
    assert_eq!(canonical_name("fipa-contract-net"), "contractnet");
}

#[test]
fn every_final_state_says_what_it_means() {
    for protocol in Library::builtin().protocols() {
        for (_, state) in protocol.states().filter(|(_, state)| state.is_final()) {
            assert!(
                state.outcome().is_some(),
                "{} {}",
                protocol.name(),
                state.id()
            );
        }
        let outcomes: BTreeSet<Outcome> =
            protocol.states().filter_map(|(_, s)| s.outcome()).collect();
        let nominal = outcomes.contains(&Outcome::Done) || outcomes.contains(&Outcome::Cancelled);
        // What goes on until it is cancelled is not done by itself.
        let endless =
            ["fipa-subscribe", "fipa-request-whenever"].contains(&protocol.name().as_str());
        assert_eq!(nominal, !endless, "{}", protocol.name());
    }
}
