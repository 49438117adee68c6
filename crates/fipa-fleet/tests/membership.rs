//! Who is let in.

use std::time::Duration;

use fipa_fleet::{FleetError, FleetKey, Membership, ROBOT_DAYS, Refusal};

const NOW: Duration = Duration::from_secs(1_795_341_600);
const DAY: Duration = Duration::from_secs(24 * 3600);

fn fleet() -> FleetKey {
    FleetKey::generate(NOW).unwrap()
}

fn join(fleet: &FleetKey, name: &str) -> Membership {
    fleet.issue(name, ROBOT_DAYS, NOW, &[], None).unwrap()
}

fn check(by: &Membership, shown: &Membership) -> Result<String, Refusal> {
    by.check(&[shown.certificate().der()], NOW)
}

#[test]
fn robots_of_a_fleet_know_each_other_by_name() {
    let fleet = fleet();
    let (one, two) = (join(&fleet, "robot1"), join(&fleet, "robot2"));
    assert_eq!(check(&one, &two), Ok("robot2".to_owned()));
    assert_eq!(check(&two, &one), Ok("robot1".to_owned()));
    assert_eq!(one.fleet(), fleet.fingerprint());
}

#[test]
fn a_robot_of_another_fleet_is_refused_whatever_it_calls_itself() {
    let one = join(&fleet(), "robot1");
    let stranger = join(&fleet(), "robot1");
    assert_eq!(check(&one, &stranger), Err(Refusal::WrongFleet));
    assert_eq!(one.check(&[], NOW), Err(Refusal::NoCertificate));
    let rubbish = one.check(&[b"rubbish"], NOW);
    assert!(matches!(rubbish, Err(Refusal::Unusable(_))), "{rubbish:?}");
}

#[test]
fn a_certificate_that_was_altered_is_refused() {
    let fleet = fleet();
    let (one, two) = (join(&fleet, "robot1"), join(&fleet, "robot2"));
    let mut der = two.certificate().der().to_vec();
    let at = der.windows(11).position(|w| w == b"fipa:robot2").unwrap();
    der[at + 10] = b'3';
    assert_eq!(one.check(&[&der], NOW), Err(Refusal::WrongFleet));
}

#[test]
fn the_certificate_of_the_fleet_is_nobodys() {
    let fleet = fleet();
    let one = join(&fleet, "robot1");
    let text = one.to_pem();
    let own = one.certificate().to_pem();
    let (_, rest) = text.split_once(own.trim_end()).unwrap();
    let authority = rest.trim().as_bytes();
    let authority = pem::parse(authority).unwrap();
    let shown = one.check(&[authority.contents()], NOW);
    assert_eq!(shown, Err(Refusal::Nameless));
}

#[test]
fn a_certificate_is_good_from_a_day_before_it_was_made_until_it_expires() {
    let fleet = fleet();
    let one = join(&fleet, "robot1");
    let two = fleet.issue("robot2", 10, NOW, &[], None).unwrap();
    let check = |now| one.check(&[two.certificate().der()], now);
    assert_eq!(two.certificate().valid_until(), Some(NOW + DAY * 10));
    for good in [NOW - DAY, NOW, NOW + DAY * 10] {
        assert_eq!(check(good), Ok("robot2".to_owned()));
    }
    let late = check(NOW + DAY * 10 + Duration::from_secs(1)).unwrap_err();
    assert!(matches!(late, Refusal::Expired { .. }), "{late:?}");
    assert!(
        late.to_string()
            .contains("robot2 expired at 2026-12-02 10:00 UTC"),
        "{late}"
    );
    let early = check(Duration::from_secs(5)).unwrap_err();
    assert!(matches!(early, Refusal::NotYetValid { .. }), "{early:?}");
    assert!(early.to_string().contains("is the clock set?"), "{early}");
}

#[test]
fn an_expired_certificate_of_another_fleet_is_of_another_fleet() {
    let one = join(&fleet(), "robot1");
    let stranger = fleet()
        .issue("robot2", 10, NOW - DAY * 20, &[], None)
        .unwrap();
    assert_eq!(check(&one, &stranger), Err(Refusal::WrongFleet));
}

#[test]
fn what_is_revoked_stays_revoked() {
    let fleet = fleet();
    let [one, two, three] = ["robot1", "robot2", "robot3"].map(|name| join(&fleet, name));
    let list = fleet
        .revoke(&[two.certificate().clone()], None, NOW)
        .unwrap();
    assert_eq!(check(&one, &two), Ok("robot2".to_owned()));
    assert!(one.learn(list.der()).unwrap());
    assert!(!one.learn(list.der()).unwrap());
    assert_eq!(
        check(&one, &two),
        Err(Refusal::Revoked("robot2".to_owned()))
    );
    assert_eq!(check(&one, &three), Ok("robot3".to_owned()));

    let more = fleet
        .revoke(&[three.certificate().clone()], Some(&list), NOW)
        .unwrap();
    assert_eq!(more.len(), 2);
    assert!(one.learn(more.der()).unwrap());
    assert_eq!(
        check(&one, &two),
        Err(Refusal::Revoked("robot2".to_owned()))
    );
    assert_eq!(
        check(&one, &three),
        Err(Refusal::Revoked("robot3".to_owned()))
    );
    let less = fleet
        .revoke(&[three.certificate().clone()], None, NOW)
        .unwrap();
    assert!(
        !one.learn(less.der()).unwrap(),
        "an older list takes nothing back"
    );
    let other = fleet
        .revoke(&[one.certificate().clone()], None, NOW)
        .unwrap();
    assert!(matches!(one.learn(other.der()), Err(FleetError::OlderList)));
    assert_eq!(
        check(&one, &two),
        Err(Refusal::Revoked("robot2".to_owned()))
    );

    let again = join(&fleet, "robot2");
    assert_eq!(check(&one, &again), Ok("robot2".to_owned()));
}

#[test]
fn a_list_that_another_key_signed_revokes_nothing() {
    let (ours, theirs) = (fleet(), fleet());
    let (one, two) = (join(&ours, "robot1"), join(&ours, "robot2"));
    let list = theirs
        .revoke(&[two.certificate().clone()], None, NOW)
        .unwrap();
    let refused = one.learn(list.der()).unwrap_err();
    assert!(
        refused.to_string().contains("not of this fleet"),
        "{refused}"
    );
    let mut forged = ours.revoke(&[], None, NOW).unwrap().der().to_vec();
    *forged.last_mut().unwrap() ^= 1;
    assert!(one.learn(&forged).is_err());
    assert!(one.learn(b"rubbish").is_err());
    assert_eq!(check(&one, &two), Ok("robot2".to_owned()));
}

#[test]
fn only_those_that_are_pinned_are_let_in_where_some_are() {
    let fleet = fleet();
    let [one, two, three] = ["robot1", "robot2", "robot3"].map(|name| join(&fleet, name));
    let stranger = join(&self::fleet(), "robot4");
    let one = one.pinned([
        two.certificate().fingerprint(),
        stranger.certificate().fingerprint(),
    ]);
    assert_eq!(check(&one, &two), Ok("robot2".to_owned()));
    let refused = check(&one, &three).unwrap_err();
    let fingerprint = three.certificate().fingerprint().to_string();
    assert!(refused.to_string().contains(&fingerprint), "{refused}");
    assert_eq!(check(&one, &stranger), Err(Refusal::WrongFleet));
}

#[test]
fn a_membership_reads_as_it_was_written() {
    let fleet = fleet();
    let two = join(&fleet, "robot2");
    let list = fleet
        .revoke(&[two.certificate().clone()], None, NOW)
        .unwrap();
    let others = [two.certificate().clone()];
    let one = fleet
        .issue("robot1", 30, NOW, &others, Some(&list))
        .unwrap();
    let read = Membership::from_pem(&one.to_pem()).unwrap();
    assert_eq!(read.to_pem(), one.to_pem());
    assert_eq!(read.robots().collect::<Vec<_>>(), ["robot1", "robot2"]);
    assert_eq!(
        check(&read, &two),
        Err(Refusal::Revoked("robot2".to_owned()))
    );
    assert!(!format!("{read:?}").contains("key"));
}

#[test]
fn files_that_are_no_memberships_say_so() {
    let one = join(&fleet(), "robot1").to_pem();
    let other = join(&fleet(), "robot1");
    let (head, _) = one.split_once("-----BEGIN CERTIFICATE").unwrap();
    let mixed = format!("{head}{}{}", other.certificate().to_pem(), {
        let authority = one.rfind("-----BEGIN CERTIFICATE").unwrap();
        &one[authority..]
    });
    for (text, said) in [
        ("", "it is not the file of a robot"),
        ("hello", "it is not the file of a robot"),
        (head, "it is not the file of a robot"),
        (&one[..one.len() - 40], "it is"),
        (
            &one.replace("PRIVATE", "PUBLIC"),
            "there is no private key in it",
        ),
        (
            &mixed,
            "the certificate here is of no use: it is not of this fleet",
        ),
    ] {
        let error = Membership::from_pem(text).unwrap_err().to_string();
        assert!(error.starts_with(said), "{error}");
    }
}
