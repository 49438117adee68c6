use super::*;

const WAIT: Duration = Duration::from_secs(10);

/// Two daemons on loopback with a port of their own, or `None` where multicast does not work.
fn two(port: u16) -> Option<(Mdns, Mdns)> {
    let start = |n: u8| {
        Mdns::start(MdnsConfig {
            instance: InstanceId::from_bytes([n; 16]),
            name: format!("unit {n}"),
            scope: "unit".to_owned(),
            endpoints: vec![([127, 0, 0, 1], 7000 + u16::from(n)).into()],
            quic: None,
            interfaces: Vec::new(),
            agents: crate::DEFAULT_AGENTS,
            port,
        })
    };
    match (start(1), start(2)) {
        (Ok(one), Ok(two)) => Some((one, two)),
        (Err(error), _) | (_, Err(error)) => {
            let missing = format!("multicast on loopback: {error}");
            assert!(
                std::env::var_os("FIPA_TEST_ALL").is_none_or(|v| v != "1"),
                "{missing}"
            );
            println!("skipped: needs {missing}");
            None
        }
    }
}

fn port() -> u16 {
    // Ports above the ephemeral range; another process only adds peers of another scope or id.
    61_000 + (std::process::id() % 4_000) as u16
}

async fn next(mdns: &mut Mdns) -> DiscoveryEvent {
    timeout(WAIT, mdns.next())
        .await
        .expect("an event in time")
        .expect("mDNS runs")
}

#[tokio::test]
async fn a_search_that_breaks_off_is_begun_anew() {
    let Some((mut one, two)) = two(port()) else {
        return;
    };
    let two_id = InstanceId::from_bytes([2; 16]);
    assert!(matches!(next(&mut one).await, DiscoveryEvent::Found(peer) if peer.instance == two_id));
    one.daemon.0.stop_browse(SERVICE_TYPE).unwrap();
    assert!(matches!(next(&mut one).await, DiscoveryEvent::Warning(_)));
    // Heard again, so it is no longer in doubt and not reported either.
    assert!(
        timeout(DOUBT_FOR + Duration::from_secs(1), one.next())
            .await
            .is_err()
    );
    // The search works on, and a loss during the interruption does not go unnoticed.
    one.daemon.0.stop_browse(SERVICE_TYPE).unwrap();
    two.shutdown().await;
    assert!(matches!(next(&mut one).await, DiscoveryEvent::Warning(_)));
    assert_eq!(next(&mut one).await, DiscoveryEvent::Lost(two_id));
    one.shutdown().await;
}

#[tokio::test]
async fn verify_needs_a_known_peer_and_the_end_is_told() {
    let Some((mut one, _two)) = two(port() + 1) else {
        return;
    };
    let nobody = InstanceId::from_bytes([9; 16]);
    assert!(matches!(one.verify(nobody), Err(MdnsError::UnknownPeer(_))));
    let stopped = one.daemon.0.shutdown().unwrap();
    stopped.recv_async().await.unwrap();
    let end = async { while one.next().await.is_some() {} };
    timeout(WAIT, end).await.expect("the end in time");
    assert!(matches!(one.verify(nobody), Err(MdnsError::UnknownPeer(_))));
}
