use std::fmt;

/// How agents agree on who has a resource.
///
/// The plain variants are the algorithms as they were published: they need agents that all stay,
/// and a network that loses nothing. The extended ones survive agents that come, go and die.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Algorithm {
    /// Ricart and Agrawala (Communications of the ACM 24, 1981): every other agent agrees.
    RicartAgrawala,
    /// The same with heartbeats, leases and fencing numbers.
    RicartAgrawalaExtended,
    /// Suzuki and Kasami (ACM Transactions on Computer Systems 3, 1985): who has the token has the
    /// resource.
    SuzukiKasami,
    /// The same with heartbeats, leases and fencing numbers; the token returns to the owner.
    SuzukiKasamiExtended,
}

impl Algorithm {
    /// All of them.
    pub const ALL: [Algorithm; 4] = [
        Algorithm::RicartAgrawala,
        Algorithm::RicartAgrawalaExtended,
        Algorithm::SuzukiKasami,
        Algorithm::SuzukiKasamiExtended,
    ];

    /// The interaction protocol of its messages, as the C++ library names it.
    pub const fn protocol(self) -> &'static str {
        match self {
            Algorithm::RicartAgrawala => "ricart_agrawala",
            Algorithm::RicartAgrawalaExtended => "ricart_agrawala_extended",
            Algorithm::SuzukiKasami => "suzuki_kasami",
            Algorithm::SuzukiKasamiExtended => "suzuki_kasami_extended",
        }
    }

    /// The algorithm whose messages have this protocol.
    pub fn from_protocol(protocol: &str) -> Option<Algorithm> {
        Algorithm::ALL
            .into_iter()
            .find(|algorithm| algorithm.protocol() == protocol)
    }

    /// Whether agents may come, go and die.
    pub const fn is_extended(self) -> bool {
        matches!(
            self,
            Algorithm::RicartAgrawalaExtended | Algorithm::SuzukiKasamiExtended
        )
    }

    /// Whether the lock is a token.
    pub const fn has_token(self) -> bool {
        matches!(
            self,
            Algorithm::SuzukiKasami | Algorithm::SuzukiKasamiExtended
        )
    }
}

impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.protocol())
    }
}
