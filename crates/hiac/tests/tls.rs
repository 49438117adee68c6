//! Stations under TLS, with certificates made here.

use std::fs;
use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use hiac::links::{Endpoint, Node, NodeEvent};
use hiac::station::{Event, Options, StationConfig, Workgroup};
use hiac::{Content, Mask};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(10);

/// An authority with a certificate of its own and one that it gave.
struct Files {
    folder: TempDir,
}

impl Files {
    /// The certificate is for this host.
    fn for_host(host: &str) -> Files {
        let folder = tempfile::tempdir().unwrap();
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        let authority = params.self_signed(&key).unwrap().pem();
        let issuer = Issuer::new(params, key);
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new([host.to_owned()]).unwrap();
        let certificate = params.signed_by(&key, &issuer).unwrap().pem();
        fs::write(folder.path().join("ca"), authority).unwrap();
        fs::write(folder.path().join("cert"), certificate).unwrap();
        fs::write(folder.path().join("key"), key.serialize_pem()).unwrap();
        Files { folder }
    }

    /// This file in a URL.
    fn url(&self, name: &str) -> String {
        format!("&{name}={}", self.folder.path().join(name).display())
    }

    fn own(&self) -> String {
        self.url("cert") + &self.url("key")
    }
}

fn node() -> Node {
    let address = "20:C4:D2:00".parse().unwrap();
    Node::new(StationConfig {
        address: Some(address),
        workgroups: vec![Workgroup {
            address,
            mask: Mask::new(0xFF).unwrap(),
        }],
        ..StationConfig::default()
    })
}

fn endpoint(url: &str) -> Endpoint {
    url.parse().unwrap()
}

/// An employer that listens with these files, and its HOST:PORT.
async fn listening(files: &str) -> (Node, String) {
    let mut employer = node();
    let listen = format!("tls://127.0.0.1:0?listen{files}");
    let bound = employer.open(&endpoint(&listen)).await.unwrap().unwrap();
    let bound = bound.to_string();
    assert!(bound.ends_with(files), "{bound}");
    let place = bound.strip_prefix("tls://").unwrap();
    let place = place.split_once('?').unwrap().0.to_owned();
    (employer, place)
}

async fn dialling(place: &str, files: &str) -> Node {
    let mut device = Node::new(StationConfig::default());
    let dial = format!("tls://{place}?role=employee{files}");
    assert_eq!(device.open(&endpoint(&dial)).await.unwrap(), None);
    device
}

async fn event(node: &mut Node) -> Event {
    let told = async {
        loop {
            if let NodeEvent::Station(event) = node.next().await {
                return event;
            }
        }
    };
    tokio::time::timeout(PATIENCE, told)
        .await
        .expect("an event")
}

/// Why a stream could not be opened.
async fn failure(node: &mut Node) -> String {
    let failed = async {
        loop {
            match node.next().await {
                NodeEvent::Failed(_, reason) => return reason,
                NodeEvent::Station(event) => panic!("{event:?}"),
                _ => {}
            }
        }
    };
    tokio::time::timeout(PATIENCE, failed)
        .await
        .expect("a failure")
}

async fn talk(employer: &mut Node, device: &mut Node) {
    let (connected, other) = tokio::join!(event(employer), event(device));
    let Event::Connected { partner, .. } = connected else {
        panic!("{connected:?}");
    };
    assert!(matches!(other, Event::Connected { .. }), "{other:?}");
    let signal = Content::Signal {
        number: 3,
        arguments: &[0xF9],
    };
    let now = employer.now();
    let station = employer.station();
    station
        .send(now, None, partner, &signal, Options::CONFIRMED)
        .unwrap();
    let confirmed = async { while !matches!(event(employer).await, Event::Confirmed(_)) {} };
    let (heard, ()) = tokio::join!(event(device), confirmed);
    assert!(
        matches!(heard, Event::Signal { number: 3, .. }),
        "{heard:?}"
    );
}

#[tokio::test]
async fn a_device_and_its_employer_know_each_other_by_their_certificates() {
    let files = Files::for_host("127.0.0.1");
    let ca = files.url("ca");
    let (mut employer, place) = listening(&(files.own() + &ca)).await;
    let mut device = dialling(&place, &(files.own() + &ca)).await;
    talk(&mut employer, &mut device).await;
}

#[tokio::test]
async fn who_listens_takes_whoever_trusts_it_unless_it_names_authorities() {
    let files = Files::for_host("127.0.0.1");
    let (mut employer, place) = listening(&files.own()).await;
    let mut device = dialling(&place, &files.url("ca")).await;
    talk(&mut employer, &mut device).await;

    let (mut employer, place) = listening(&(files.own() + &files.url("ca"))).await;
    let _nobody = dialling(&place, &files.url("ca")).await;
    let stranger = Files::for_host("127.0.0.1");
    let _other = dialling(&place, &(stranger.own() + &files.url("ca"))).await;
    for _ in 0..2 {
        let said = failure(&mut employer).await;
        let refused = said.contains("certificate");
        assert!(refused, "{said}");
    }
}

#[tokio::test]
async fn who_cannot_be_verified_is_not_talked_to() {
    let files = Files::for_host("127.0.0.1");
    let stranger = Files::for_host("127.0.0.1");
    let elsewhere = Files::for_host("robot7");
    for (own, ca, said) in [
        (&files, &stranger, "invalid peer certificate"),
        (&elsewhere, &elsewhere, "not valid for name"),
    ] {
        let (mut employer, place) = listening(&own.own()).await;
        let mut device = dialling(&place, &ca.url("ca")).await;
        let (refused, failed) = tokio::join!(failure(&mut employer), failure(&mut device));
        assert!(failed.contains(said), "{failed}");
        assert!(refused.contains("alert"), "{refused}");
    }
}

#[tokio::test]
async fn a_caller_without_tls_is_refused_and_others_are_taken() {
    let files = Files::for_host("127.0.0.1");
    let (mut employer, place) = listening(&files.own()).await;
    let mut plain = TcpStream::connect(&place).unwrap();
    plain.write_all(&[0xF8, 0xF9]).unwrap();
    plain.write_all(&[0xF8; 64]).unwrap();
    let said = failure(&mut employer).await;
    assert!(said.contains("corrupt"), "{said}");
    // It is held, and says nothing.
    let _silent = TcpStream::connect(&place).unwrap();
    let mut device = dialling(&place, &files.url("ca")).await;
    talk(&mut employer, &mut device).await;
}

#[tokio::test]
async fn files_that_cannot_be_used_are_named() {
    let files = Files::for_host("127.0.0.1");
    let other = Files::for_host("127.0.0.1");
    let empty = files.folder.path().join("empty");
    fs::write(&empty, "").unwrap();
    let empty = empty.display();
    for (url, said) in [
        (
            "tls://127.0.0.1:1?ca=/nowhere/ca".to_owned(),
            "/nowhere/ca: ",
        ),
        (
            format!("tls://127.0.0.1:1?ca={empty}"),
            "empty: there is no",
        ),
        (
            format!("tls://127.0.0.1:0?listen&cert={empty}{}", files.url("key")),
            "empty: there is no",
        ),
        (
            format!("tls://127.0.0.1:0?listen{}&key={empty}", files.url("cert")),
            "empty: ",
        ),
        (
            format!(
                "tls://127.0.0.1:0?listen{}{}",
                files.url("cert"),
                other.url("key")
            ),
            "keys may not be consistent",
        ),
    ] {
        let error = node().open(&endpoint(&url)).await.unwrap_err();
        assert!(error.to_string().contains(said), "{url}: {error}");
    }
}

#[test]
fn what_tls_needs_stands_in_the_url() {
    for url in [
        "tls://robot1:5000?ca=/etc/hiac/ca.pem",
        "tls://[::1]:5000?cert=/c.pem&key=/k.pem&ca=/a.pem&role=employee",
        "tls://0.0.0.0:5000?listen&cert=/c.pem&key=/k.pem",
        "tls://0.0.0.0:5000?listen&cert=/c.pem&key=/k.pem&ca=/a.pem&address=20:C4:D2:05",
    ] {
        assert_eq!(endpoint(url).to_string(), url);
    }
    for (url, said) in [
        ("tls://robot1:5000", "cannot be verified"),
        ("tls://robot1:5000?cert=/c&key=/k", "cannot be verified"),
        ("tls://robot1:5000?ca=/a&key=/k", "cert=FILE and key=FILE"),
        ("tls://robot1:5000?listen", "cert=FILE and key=FILE"),
        ("tls://robot1:5000?listen&ca=/a", "cert=FILE and key=FILE"),
        ("tls://robot1:5000?ca=", "is no place"),
        ("tls://robot1?ca=/a", "is no place"),
        ("tcp://robot1:5000?ca=/a", "is no place"),
        ("serial:///dev/ttyS0?ca=/a", "is no place"),
    ] {
        let error = url.parse::<Endpoint>().unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}
