//! Reading and writing messages.

use proptest::collection::btree_map;
use proptest::option;
use proptest::prelude::*;
use robot_text::{Fault, Kind, MAX_OCTETS, Message, Reader, WriteError, parse};

fn read(octets: &[u8]) -> Vec<Result<Message, (Fault, Vec<u8>)>> {
    let mut reader = Reader::new();
    reader.push(octets);
    reader.end();
    let told = |read: Result<_, robot_text::Unreadable>| read.map_err(|u| (u.fault, u.octets));
    reader.map(told).collect()
}

#[test]
fn blanks_around_keys_and_values_are_ignored_and_both_separators_read() {
    let message = parse(b"{O: MAITRE ; D: ESCLAVE ; X=1 ; A: COM}").unwrap();
    let expected = Message::new(Kind::Action, "COM")
        .from("MAITRE")
        .to("ESCLAVE")
        .reference("1");
    assert_eq!(message, expected);
    assert_eq!(
        parse(b"{\tO:MAITRE\r\n;D : ESCLAVE;X=1;A= COM }"),
        Ok(expected)
    );
}

#[test]
fn a_value_keeps_its_inner_blanks_and_separators() {
    let message = parse(b"{D=B;A=go=1:2 x;}").unwrap();
    assert_eq!(message.text(), "go=1:2 x");
    assert_eq!(message.to_text().unwrap(), "{D:B;A:go=1:2 x}");
}

#[test]
fn an_answer_goes_back_with_the_reference() {
    let question = parse(b"{O:MAITRE;D:ESCLAVE;X=3;Q:QUESTION}").unwrap();
    let answer = question.answer("REPONSE");
    assert_eq!(
        answer.to_text().unwrap(),
        "{O:ESCLAVE;D:MAITRE;X=3;R:REPONSE}"
    );
}

#[test]
fn a_status_has_no_receiver() {
    let status = parse(b"{O:ESCLAVE;S:PANNE}").unwrap();
    assert_eq!(status, Message::new(Kind::Status, "PANNE").from("ESCLAVE"));
}

#[test]
fn unknown_keys_are_kept_and_written_last_in_their_order() {
    let message = parse(b"{Z:9;A:;b=;D:B;U=7}").unwrap();
    assert_eq!((message.urgency, message.text()), (Some(7), ""));
    let other: Vec<_> = message.other.iter().collect();
    assert_eq!(
        other,
        [
            (&"Z".to_owned(), &"9".to_owned()),
            (&"b".to_owned(), &String::new())
        ]
    );
    assert_eq!(message.to_text().unwrap(), "{D:B;U=7;A:;Z:9;b:}");
}

#[test]
fn the_first_fault_of_the_order_is_told() {
    for (octets, fault) in [
        (&b"{O:A;D:B;S:x}"[..], Fault::Unexpected),
        (b"{O:A;Q:x}", Fault::Missing),
        (b"{Q:x;D:B}", Fault::Missing),
        (b"{S:x}", Fault::Missing),
        (b"{A:x}", Fault::Missing),
        (b"{D:;S:x;O:A}", Fault::Missing),
        (b"{D:B;A:x;X:}", Fault::Missing),
        (b"{D:B;A:x;A:y}", Fault::Duplicate),
        (b"{D:B;A:x;Q:y}", Fault::Kind),
        (b"{D:B}", Fault::Kind),
        (b"{D:B;A:x;;}", Fault::Syntax),
        (b"{;D:B;A:x}", Fault::Syntax),
        (b"{}", Fault::Syntax),
        (b"{;}", Fault::Syntax),
        (b"{D:B;A}", Fault::Syntax),
        (b"{D:B;:x;A:y}", Fault::Syntax),
        (b"{D:B;k y:x;A:y}", Fault::Syntax),
        ("{D:B;A:é}".as_bytes(), Fault::Character),
        (b"{D:B;A:a\tb}", Fault::Character),
        (b"{D:B;;A:a\x7f}", Fault::Character),
        (b"{D:B;A:x;U=10}", Fault::Urgency),
        (b"{D:B;A:x;U=}", Fault::Urgency),
        (b"{D:B;A:x;U=a}", Fault::Urgency),
        (b"{D:B;A:x", Fault::Unfinished),
    ] {
        assert_eq!(read(octets), [Err((fault, octets.to_vec()))]);
    }
}

#[test]
fn noise_is_passed_over_and_an_unfinished_message_told() {
    let expected = Message::new(Kind::Action, "x").to("B");
    assert_eq!(
        read(b"..}{O:A;D:B{D:B;A:x} }\n"),
        [Err((Fault::Unfinished, b"{O:A;D:B".to_vec())), Ok(expected)]
    );
}

#[test]
fn a_message_that_is_too_long_is_dropped_up_to_the_next_brace() {
    let fill = |octets: usize| format!("{{D:B;A:{}}}", "x".repeat(octets - 8));
    let (longest, longer) = (fill(MAX_OCTETS), fill(MAX_OCTETS + 1));
    let stream = format!("{longer}x}}{longest}");
    let read = read(stream.as_bytes());
    let [Err((Fault::Length, octets)), Ok(message)] = read.as_slice() else {
        panic!("{read:?}");
    };
    assert_eq!(octets.as_slice(), &longer.as_bytes()[..MAX_OCTETS]);
    assert_eq!(message.to_text().unwrap(), longest);
    assert_eq!(parse(longer.as_bytes()), Err(Fault::Length));
}

#[test]
fn what_could_not_be_read_back_is_not_written() {
    let action = |text: &str| Message::new(Kind::Action, text).to("B");
    let value = |text: &str| WriteError::Value {
        key: "A".to_owned(),
        value: text.to_owned(),
    };
    for text in [" x", "x ", "a;b", "{", "}", "é", "a\tb"] {
        assert_eq!(action(text).to_text(), Err(value(text)));
    }
    let long = "x".repeat(MAX_OCTETS);
    assert_eq!(
        action(&long).to_text(),
        Err(WriteError::Length(MAX_OCTETS + 8))
    );
    for key in ["", "k y", "a:b", "A", "O", "é"] {
        let mut message = action("x");
        message.other.insert(key.to_owned(), String::new());
        assert_eq!(message.to_text(), Err(WriteError::Key(key.to_owned())));
    }
    let mut message = action("x");
    message.urgency = Some(10);
    assert_eq!(message.to_text(), Err(WriteError::Urgency(10)));
    assert_eq!(
        action("x").reference("").to_text(),
        Err(WriteError::Missing)
    );
    assert_eq!(
        Message::new(Kind::Action, "x").to_text(),
        Err(WriteError::Missing)
    );
    let status = Message::new(Kind::Status, "x").from("A").to("B");
    assert_eq!(status.to_text(), Err(WriteError::Unexpected));
}

fn messages() -> impl Strategy<Value = Message> {
    let value = "[!-:<-z|~]([ -:<-z|~]{0,12}[!-:<-z|~])?";
    let body = prop_oneof![Just(String::new()), value];
    let other = btree_map(
        "[a-z!-9]{1,4}".prop_filter("a key", |key| !key.contains(':')),
        body.clone(),
        0..3,
    );
    let fields = (
        value,
        value,
        option::of(value),
        option::of(0..=9u8),
        body,
        other,
    );
    (0..4usize, any::<bool>(), fields).prop_map(|(kind, anonymous, fields)| {
        let kind = Kind::ALL[kind];
        let (origin, destination, reference, urgency, text, other) = fields;
        let mut message = Message::new(kind, text);
        message.origin = Some(origin).filter(|_| kind != Kind::Action || !anonymous);
        message.destination = Some(destination).filter(|_| kind != Kind::Status);
        Message {
            reference,
            urgency,
            other,
            ..message
        }
    })
}

proptest! {
    #[test]
    fn what_is_written_is_read_as_the_same(message in messages()) {
        let text = message.to_text().unwrap();
        prop_assert_eq!(parse(text.as_bytes()), Ok(message));
    }

    #[test]
    fn a_stream_is_read_the_same_however_it_is_cut(
        octets in proptest::collection::vec(
            prop_oneof![Just(b'{'), Just(b'}'), Just(b';'), Just(b':'), Just(b'A'), Just(b'D'), any::<u8>()],
            0..200,
        ),
        cut in 0..200usize,
    ) {
        let whole = read(&octets);
        let mut reader = Reader::new();
        let (head, tail) = octets.split_at(cut.min(octets.len()));
        reader.push(head);
        reader.push(tail);
        reader.end();
        let parts: Vec<_> = reader.map(|read| read.map_err(|u| (u.fault, u.octets))).collect();
        prop_assert_eq!(&parts, &whole);
        for message in whole.into_iter().flatten() {
            prop_assert!(parse(message.to_text().unwrap().as_bytes()).is_ok());
        }
    }
}
