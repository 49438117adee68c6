//! Real mDNS, on loopback or between network namespaces that the tests make.
mod discovery;
mod neighbours;
mod support;
mod traffic;

/// Not a test of its own: the process that other tests start as a daemon.
#[test]
fn peer_process() {
    support::peer::run_if_asked();
}
