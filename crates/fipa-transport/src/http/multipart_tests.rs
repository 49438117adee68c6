use proptest::collection::vec;
use proptest::prelude::*;

use super::*;

/// A body with the boundary of this seed, and that boundary.
fn written(envelope: &Bytes, payload: &Bytes, seed: u64) -> (Bytes, String) {
    let boundary = Boundary::random(&mut fastrand::Rng::with_seed(seed));
    let multipart = Multipart::new(&boundary, envelope, payload, "application/text");
    let mut body = Vec::new();
    multipart.write_head(&mut body);
    body.extend_from_slice(payload);
    multipart.write_tail(&mut body);
    assert_eq!(body.len(), multipart.len());
    (body.into(), multipart.boundary.as_str().to_owned())
}

/// Octets among which those are frequent that delimiters consist of.
fn octets() -> impl Strategy<Value = Vec<u8>> {
    let octet = prop_oneof![
        Just(b'\r'),
        Just(b'\n'),
        Just(b'-'),
        Just(b'B'),
        any::<u8>()
    ];
    vec(octet, 0..200)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn what_is_written_is_read_back(envelope in octets(), payload in octets(), seed: u64) {
        let (envelope, payload) = (Bytes::from(envelope), Bytes::from(payload));
        let (body, boundary) = written(&envelope, &payload, seed);
        prop_assert_eq!(boundary.len(), 31);
        prop_assert_eq!(read(&body, &boundary), Ok((envelope, payload)));
    }

    #[test]
    fn no_octets_make_the_reader_panic(body in octets(), boundary in "[B-]{1,3}") {
        let _ = read(&Bytes::from(body), &boundary);
    }

    #[test]
    fn no_content_type_makes_the_reader_panic(content_type in "multipart/mixed ?;\\PC*") {
        let _ = boundary_of(&content_type);
    }
}

#[test]
fn a_body_without_its_end_is_never_taken_for_a_whole_one() {
    let (envelope, payload) = (Bytes::from("<e/>"), Bytes::from("(inform)\r\n\r"));
    let (body, boundary) = written(&envelope, &payload, 1);
    let whole = body.len() - 2;
    for end in 0..whole {
        assert!(read(&body.slice(..end), &boundary).is_err(), "{end}");
    }
    assert!(read(&body.slice(..whole), &boundary).is_ok());
}

#[test]
fn a_letter_that_holds_the_boundary_gets_another_one() {
    let (envelope, payload) = (Bytes::from("<e/>"), Bytes::from("(inform)"));
    let (_, boundary) = written(&envelope, &payload, 1);
    let payload = Bytes::from(format!("(inform)\r\n--{boundary}--\r\n"));
    let (body, other) = written(&envelope, &payload, 1);
    assert_ne!(other, boundary);
    assert_eq!(read(&body, &other), Ok((envelope, payload)));
}

#[test]
fn boundaries_are_read_in_every_spelling() {
    for (content_type, boundary) in [
        ("multipart/mixed ; boundary=\"4157ea4e\"", "4157ea4e"),
        ("multipart/mixed;boundary=B", "B"),
        (
            "Multipart/Mixed; charset=utf-8; Boundary=\"a b;c\"",
            "a b;c",
        ),
        ("multipart-mixed; x=\"boundary=no;\"; boundary=yes", "yes"),
        ("multipart/mixed;\r\n boundary=\"fold\\\"ed\"", "fold\"ed"),
    ] {
        assert_eq!(boundary_of(content_type).as_deref(), Ok(boundary));
    }
    use MultipartError::{NoBoundary, NotMultipart};
    let long = format!("multipart/mixed; boundary={}", "b".repeat(71));
    for (content_type, error) in [
        ("multipart/related; boundary=B", NotMultipart),
        ("", NotMultipart),
        ("multipart/mixed", NoBoundary),
        ("multipart/mixed; boundary=\"\"", NoBoundary),
        ("multipart/mixed; boundary=\"b\r\n\"", NoBoundary),
        (&long, NoBoundary),
    ] {
        assert_eq!(boundary_of(content_type), Err(error), "{content_type}");
    }
}

#[test]
fn bodies_of_others_are_read() {
    let parts = (Bytes::from("<e/>"), Bytes::from("(inform)\r"));
    for body in [
        "--B\r\n\r\n<e/>\r\n--B\r\n\r\n(inform)\r\r\n--B--",
        "preamble --B\r\n--B \t\r\nX-A: 1\r\nContent-Type: x\r\n\r\n<e/>\r\n--B\r\nA: b\r\n c\r\n\r\n(inform)\r\r\n--B--  \r\nepilogue",
        "\r\n\r\n--B\r\n\r\n<e/>\r\n--B\r\n\r\n(inform)\r\r\n--B\r\n\r\nthird\r\n--B--",
        "--B\n\n<e/>\n--B\ncontent-transfer-encoding: 8BIT\n\n(inform)\r\r\n--B--\n",
        "--Bc\r\n--B\r\n\r\n<e/>\r\n--B\r\n\r\n(inform)\r\r\n--B--",
    ] {
        assert_eq!(read(&body.into(), "B"), Ok(parts.clone()), "{body:?}");
    }
}

#[test]
fn what_is_wrong_with_a_body_is_told() {
    for (body, said) in [
        (
            "",
            "octet 0: the body ends, and the first delimiter is missing",
        ),
        (
            "--B--",
            "octet 5: the body ends, and the envelope is missing",
        ),
        (
            "--B\r\n\r\n<e/>\r\n--B--",
            "octet 18: the body ends, and the payload is missing",
        ),
        (
            "--B\r\n<e/>\r\n--B\r\n\r\nx\r\n--B--",
            "octet 5: the header of a part does not end in an empty line",
        ),
        (
            "--B\r\n\r\n<e/>\r\n--B\r\nContent-Transfer-Encoding: base64\r\n\r\nKA==\r\n--B--",
            "octet 18: the part has a Content-Transfer-Encoding; its octets must stand as they are",
        ),
    ] {
        assert_eq!(read(&body.into(), "B").unwrap_err().to_string(), said);
    }
}
