use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

use crate::names::canonical_name;
use crate::protocol::Protocol;
use crate::{Limits, load};

/// Protocols by all their names.
#[derive(Clone, Debug, Default)]
pub struct Library {
    by_name: HashMap<String, Arc<Protocol>>,
}

macro_rules! files {
    ($($name:literal)*) => {
        [$(($name, include_str!(concat!("../../../protocols/", $name, ".scxml"))),)*]
    };
}

/// The files of `protocols/`.
const FILES: [(&str, &str); 21] = files!(
    "brokering" "cancel" "contract-net" "dlm_discover" "dlm_list" "dlm_probe" "dutch-auction"
    "english-auction" "inform" "iterated-contract-net" "propose" "query" "recruiting" "request"
    "request-when" "request-whenever" "ricart_agrawala" "ricart_agrawala_extended" "subscribe"
    "suzuki_kasami" "suzuki_kasami_extended"
);

static BUILTIN: LazyLock<Library> = LazyLock::new(|| {
    let mut library = Library::new();
    for (name, text) in FILES {
        // A test loads each of them.
        let loaded = load(name, text.as_bytes(), &Limits::default());
        if let Some(protocol) = loaded.ok().and_then(|loaded| loaded.protocol) {
            library.add(protocol);
        }
    }
    library
});

impl Library {
    /// A library without protocols.
    pub fn new() -> Library {
        Library::default()
    }

    /// The protocols of FIPA, and those of the distributed locks.
    pub fn builtin() -> Library {
        BUILTIN.clone()
    }

    /// Adds a protocol under its name and its aliases; it replaces what had one of them.
    pub fn add(&mut self, protocol: Protocol) -> Arc<Protocol> {
        let protocol = Arc::new(protocol);
        let names = std::iter::once(protocol.name()).chain(protocol.aliases());
        for name in names {
            self.by_name
                .insert(canonical_name(name), Arc::clone(&protocol));
        }
        protocol
    }

    /// The protocol that bears this name in any of its forms.
    pub fn get(&self, name: &str) -> Option<&Arc<Protocol>> {
        self.by_name.get(&canonical_name(name))
    }

    /// The protocols by name, each once.
    pub fn protocols(&self) -> Vec<&Arc<Protocol>> {
        let mut all: Vec<&Arc<Protocol>> = self.by_name.values().collect();
        all.sort_by(|a, b| a.name().cmp(b.name()));
        all.dedup_by(|a, b| Arc::ptr_eq(a, b));
        all
    }
}

/// The protocol of FIPA, or of the distributed locks, that bears this name in any of its forms:
/// `fipa-contract-net`, `contract-net` and `contractNet` are one.
///
/// ```
/// let request = fipa_protocol::builtin("request").unwrap();
/// assert_eq!(request.name(), "fipa-request");
/// assert_eq!(fipa_protocol::builtin("contractNet").unwrap().name(), "fipa-contract-net");
/// ```
pub fn builtin(name: &str) -> Option<Arc<Protocol>> {
    BUILTIN.get(name).cloned()
}
