//! Somebody at the other end of a connection who minds nothing: a robot, or one who would be.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa::{Entry, InstanceId, Now, Source, State, Text};
use fipa_fleet::Membership;
use fipa_link::{
    DirectoryFrame, DirectoryItem, Event, Frame, Hello, LetterFrame, Link, LinkConfig, Role,
};
use rustls::client::ResolvesClientCert;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::ring::default_provider;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName, UnixTime};
use rustls::sign::CertifiedKey;
use rustls::{
    ClientConfig, ClientConnection, DigitallySignedStruct, Error, SignatureScheme, StreamOwned,
};

use crate::over_quic::Called;
use crate::support::PATIENCE;

/// What passes as a robot's run.
const INSTANCE: InstanceId = InstanceId::from_bytes([7; 16]);

/// What somebody does once connected: says who it is, tells of an agent, and sends a letter.
pub(crate) struct Intrusion {
    /// The name of its service.
    pub(crate) name: &'static str,
    /// The agent that it tells of.
    pub(crate) agent: &'static str,
    /// The sender of its letter.
    pub(crate) from: &'static str,
    /// The receiver of its letter.
    pub(crate) to: &'static str,
}

/// What came of it.
#[derive(Debug, Default)]
pub(crate) struct Answer {
    /// The outcome of the letter, and why.
    pub(crate) receipt: Option<(String, String)>,
    /// Why the link was ended.
    pub(crate) goodbye: Option<String>,
}

impl Intrusion {
    /// As a robot with its own agent and its own letter.
    pub(crate) fn honest(name: &'static str, agent: &'static str) -> Intrusion {
        Intrusion {
            name,
            agent,
            from: agent,
            to: "sink@robot1",
        }
    }

    /// Without a key.
    pub(crate) fn plainly(&self, endpoint: &str) -> Answer {
        let address = endpoint.strip_prefix("tcp://").unwrap();
        self.over(TcpStream::connect(address).unwrap())
    }

    /// With this certificate and key, or none, over TLS or QUIC.
    pub(crate) fn secretly(&self, endpoint: &str, shown: Option<&Membership>) -> Answer {
        let (scheme, address) = endpoint.split_once("://").unwrap();
        if scheme == "quic" {
            let called = Called::call(address.parse().unwrap(), config(shown));
            return called.map_or_else(Answer::default, |called| self.over(called));
        }
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let name = ServerName::try_from("fleet.invalid").unwrap();
        let session = ClientConnection::new(Arc::new(config(shown)), name).unwrap();
        self.over(StreamOwned::new(session, stream))
    }

    /// Says it all, and listens until the letter is answered or the other side ends.
    fn over(&self, mut stream: impl Read + Write) -> Answer {
        let now = Now {
            mono: Duration::from_secs(1),
            unix_millis: 0,
        };
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance: INSTANCE,
            name: Text::from(self.name),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: 1 << 20,
            unix_millis: 0,
            checks: false,
        };
        let mut link = Link::new(LinkConfig::new(hello), now);
        link.send(now, Frame::Directory(self.directory()));
        link.send(
            now,
            Frame::Letter(LetterFrame {
                id: 1,
                ttl_millis: 5000,
                parts: letter(self.from, self.to).into(),
            }),
        );
        let mut answer = Answer::default();
        let mut heard = BytesMut::new();
        let mut chunk = [0; 4096];
        loop {
            while let Some(part) = link.poll_transmit() {
                if stream.write_all(&part).is_err() {
                    return answer;
                }
            }
            while let Ok(Some(event)) = link.receive(now, &mut heard) {
                match event {
                    Event::Frame(Frame::Receipt { outcomes, .. }) => {
                        let told = outcomes.first().unwrap();
                        answer.receipt = Some((told.outcome.to_string(), told.reason.to_string()));
                        return answer;
                    }
                    Event::Frame(Frame::Goodbye(reason)) => {
                        answer.goodbye = Some(reason.to_string())
                    }
                    _ => {}
                }
            }
            match stream.read(&mut chunk) {
                Ok(octets @ 1..) => heard.extend_from_slice(&chunk[..octets]),
                _ => return answer,
            }
        }
    }

    fn directory(&self) -> DirectoryFrame {
        DirectoryFrame {
            version: 1,
            snapshot: true,
            more: false,
            items: vec![DirectoryItem::Put {
                owner: INSTANCE,
                source: Source::Local,
                state: State::Alive,
                age_millis: 0,
                entry: Entry::new(self.agent),
            }],
        }
    }
}

/// A letter as it stands on a wire.
pub(crate) fn letter(from: &str, to: &str) -> Bytes {
    let message = serde_json::json!({
        "performative": "inform", "sender": {"name": from}, "receiver": [{"name": to}],
        "content": "let me in",
    });
    let mut encode = Command::new(env!("CARGO_BIN_EXE_fipa"))
        .args([
            "encode",
            "--as",
            "bit-efficient",
            "--envelope",
            "bit-efficient",
        ])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = encode.stdin.take().unwrap();
    input.write_all(message.to_string().as_bytes()).unwrap();
    drop(input);
    let output = encode.wait_with_output().unwrap();
    assert!(output.status.success());
    Bytes::from(output.stdout)
}

fn config(shown: Option<&Membership>) -> ClientConfig {
    let provider = default_provider();
    let shown = shown.map(|membership| {
        let key = PrivatePkcs8KeyDer::from(membership.private_key().to_vec());
        let key = provider
            .key_provider
            .load_private_key(PrivateKeyDer::from(key));
        let certificate = CertificateDer::from(membership.certificate().der().to_vec());
        Arc::new(CertifiedKey::new(vec![certificate], key.unwrap()))
    });
    let mut config = ClientConfig::builder_with_provider(Arc::new(provider))
        .with_safe_default_protocol_versions()
        .unwrap()
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(Minding))
        .with_client_cert_resolver(Arc::new(Shown(shown)));
    config.alpn_protocols = vec![b"fipa/1".to_vec()];
    config
}

/// Takes whoever answers.
#[derive(Debug)]
struct Minding;

impl ServerCertVerifier for Minding {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        default_provider()
            .signature_verification_algorithms
            .supported_schemes()
    }
}

/// Shows this, whoever asks and whatever for.
#[derive(Debug)]
struct Shown(Option<Arc<CertifiedKey>>);

impl ResolvesClientCert for Shown {
    fn resolve(&self, _: &[&[u8]], _: &[SignatureScheme]) -> Option<Arc<CertifiedKey>> {
        self.0.clone()
    }

    fn has_certs(&self) -> bool {
        self.0.is_some()
    }
}
