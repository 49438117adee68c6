//! What is stored is there again; what is damaged is not taken for empty.

use std::fs;
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_mts::StoredLetter;
use fipa_outbox::{FILE_NAME, OpenError, Store, open};

const PATIENCE: Duration = Duration::from_secs(30);

fn letter(key: u64, octets: usize) -> StoredLetter {
    StoredLetter {
        key,
        to: Text::from("b@robot2"),
        peer: Text::from("robot2"),
        since: 1_795_341_600_000,
        reply_by: key.is_multiple_of(2).then_some(1_795_341_700_000),
        octets: Bytes::from(vec![key as u8; octets]),
    }
}

type Told = Receiver<(u64, Result<(), String>)>;

/// The letters in an outbox, and the outbox at work.
fn start(folder: &Path) -> (Vec<StoredLetter>, Store, Told) {
    let mut opened = open(folder).unwrap();
    let letters = opened.take_letters();
    let (sender, told) = channel();
    let stored = move |key, result| sender.send((key, result)).unwrap();
    (letters, opened.start(stored).unwrap(), told)
}

fn keys(letters: &[StoredLetter]) -> Vec<u64> {
    letters.iter().map(|letter| letter.key).collect()
}

#[test]
fn letters_are_there_again_in_order_and_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("made/on/demand");
    let (none, store, told) = start(&folder);
    assert_eq!(none, []);
    let given: Vec<StoredLetter> = (1..=300).map(|key| letter(key, 1000)).collect();
    given.iter().for_each(|letter| store.put(letter.clone()));
    for letter in &given {
        let answer = told.recv_timeout(PATIENCE).unwrap();
        assert_eq!(answer, (letter.key, Ok(())));
    }
    store.remove(2);
    store.close();
    let (letters, store, _) = start(&folder);
    assert_eq!(letters[0], given[0]);
    assert_eq!(letters[1..], given[2..]);
    store.close();
}

#[test]
fn what_was_told_to_be_stored_needs_no_orderly_end() {
    let folder = tempfile::tempdir().unwrap();
    let (_, store, told) = start(folder.path());
    store.put(letter(7, 100));
    assert_eq!(told.recv_timeout(PATIENCE).unwrap(), (7, Ok(())));
    // What a crash leaves: the file as it is now.
    let copy = tempfile::tempdir().unwrap();
    fs::copy(folder.path().join(FILE_NAME), copy.path().join(FILE_NAME)).unwrap();
    let (letters, other, _) = start(copy.path());
    assert_eq!(letters, [letter(7, 100)]);
    other.close();
    store.close();
}

#[test]
fn an_outbox_belongs_to_one_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let (_, store, _told) = start(folder.path());
    let error = open(folder.path()).unwrap_err();
    assert!(matches!(error, OpenError::InUse(_)), "{error}");
    store.close();
    assert!(open(folder.path()).is_ok());
}

#[test]
fn a_damaged_file_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(FILE_NAME);
    let (_, store, _told) = start(folder.path());
    (1..200).for_each(|key| store.put(letter(key, 500)));
    store.close();
    let whole = fs::read(&file).unwrap();
    let used = whole.windows(500).position(|w| w == [100; 500]).unwrap();
    let mut damages: Vec<Vec<u8>> = vec![b"something else".to_vec(), whole[..5000].to_vec()];
    for at in [0, 64, used] {
        let mut damaged = whole.clone();
        damaged[at..at + 64].fill(0xa5);
        damages.push(damaged);
    }
    for damaged in damages {
        fs::write(&file, &damaged).unwrap();
        let error = open(folder.path()).unwrap_err();
        assert!(matches!(error, OpenError::Damaged { .. }), "{error:?}");
        assert!(error.to_string().contains(&file.display().to_string()));
    }
    fs::write(&file, &whole).unwrap();
    let letters = open(folder.path()).unwrap().take_letters();
    assert_eq!(keys(&letters), (1..200).collect::<Vec<u64>>());
}

#[test]
fn a_directory_that_cannot_be_made_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = open(file.join("below")).unwrap_err();
    assert!(matches!(error, OpenError::Directory { .. }), "{error}");
}
