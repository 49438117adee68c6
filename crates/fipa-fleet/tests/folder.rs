//! The folders of an operator and of robots.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

use fipa_fleet::{FleetError, Folder, Installed, Refusal, default_folder};

const NOW: Duration = Duration::from_secs(1_795_341_600);

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn a_fleet_is_made_robots_join_and_one_is_revoked() {
    let place = tempfile::tempdir().unwrap();
    let operator = Folder::new(place.path().join("operator/fleet"));
    let missing = operator.issue("robot1", 10, NOW).unwrap_err();
    assert!(missing.to_string().contains("fipa key init"), "{missing}");
    operator.init(NOW).unwrap();
    assert!(matches!(operator.init(NOW), Err(FleetError::Exists(_))));

    let robots = ["robot1", "robot2"].map(|name| {
        let folder = Folder::new(place.path().join(name));
        assert!(matches!(
            folder.membership(),
            Err(FleetError::NotInFleet(_))
        ));
        let text = operator.issue(name, 10, NOW).unwrap().to_pem();
        assert_eq!(
            folder.install(&text).unwrap(),
            Installed::Robot(name.to_owned())
        );
        folder
    });
    let [one, two] = robots.each_ref().map(|folder| folder.membership().unwrap());
    let two = two.certificate().der();
    assert_eq!(one.check(&[two], NOW), Ok("robot2".to_owned()));
    let names: Vec<String> = operator
        .issued()
        .unwrap()
        .iter()
        .map(|c| c.name().to_owned())
        .collect();
    assert_eq!(names, ["robot1", "robot2"]);

    assert!(matches!(
        operator.revoke("robot3", NOW),
        Err(FleetError::UnknownRobot(_))
    ));
    let list = operator.revoke("robot2", NOW).unwrap();
    let installed = robots[0].install(&list.to_pem()).unwrap();
    assert_eq!(installed, Installed::Revocations { news: true });
    let installed = robots[0].install(&list.to_pem()).unwrap();
    assert_eq!(installed, Installed::Revocations { news: false });
    let one = robots[0].membership().unwrap();
    assert_eq!(
        one.check(&[two], NOW),
        Err(Refusal::Revoked("robot2".to_owned()))
    );
    let three = operator.issue("robot3", 10, NOW).unwrap();
    assert_eq!(
        three.check(&[two], NOW),
        Err(Refusal::Revoked("robot2".to_owned()))
    );
}

#[test]
fn nobody_else_may_read_what_is_kept() {
    let place = tempfile::tempdir().unwrap();
    let folder = Folder::new(place.path().join("fleet"));
    folder.init(NOW).unwrap();
    let membership = folder.issue("robot1", 10, NOW).unwrap();
    folder.install(&membership.to_pem()).unwrap();
    folder.revoke("robot1", NOW).unwrap();
    assert_eq!(mode(folder.path()), 0o700);
    for file in ["fleet.key", "robot.fleet", "revoked.pem"] {
        assert_eq!(mode(&folder.path().join(file)), 0o600, "{file}");
    }
    let entries = fs::read_dir(folder.path()).unwrap();
    assert_eq!(entries.count(), 4, "nothing is left over");
}

#[test]
fn a_damaged_file_is_named() {
    let place = tempfile::tempdir().unwrap();
    let folder = Folder::new(place.path());
    fs::write(place.path().join("robot.fleet"), "what").unwrap();
    let error = folder.membership().unwrap_err().to_string();
    assert!(
        error.contains("robot.fleet: it is not the file of a robot"),
        "{error}"
    );
}

#[test]
fn the_default_folder_is_in_the_configuration_of_the_user() {
    let env = |known: &'static [(&str, &str)]| {
        move |name: &str| {
            let found = known.iter().find(|(key, _)| *key == name);
            found.map(|(_, value)| value.into())
        }
    };
    let shown = |known| default_folder(env(known)).map(|path| path.display().to_string());
    assert_eq!(
        shown(&[("XDG_CONFIG_HOME", "/c"), ("HOME", "/h")]).unwrap(),
        "/c/fipa/fleet"
    );
    assert_eq!(
        shown(&[("XDG_CONFIG_HOME", ""), ("HOME", "/h")]).unwrap(),
        "/h/.config/fipa/fleet"
    );
    assert_eq!(shown(&[]), None);
}
