//! Hostile documents are refused, and cost no more than honest ones.

mod xml_support;

use bytes::Bytes;
use fipa_codec::xml::{decode_envelope, decode_letter, decode_letter_prefix, decode_message};
use fipa_codec::{Fault, Limits};

const MANY: usize = 1 << 20;

fn fault_of(octets: Vec<u8>) -> Fault {
    let octets = Bytes::from(octets);
    decode_message(&octets, &Limits::default())
        .unwrap_err()
        .fault
}

fn envelope_fault(octets: Vec<u8>) -> Fault {
    let octets = Bytes::from(octets);
    decode_envelope(&octets, &Limits::default())
        .unwrap_err()
        .fault
}

/// The most address space that this process ever had, in octets, where the system tells.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmPeak:"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    number.map_or(0, |number| number.parse::<u64>().unwrap() * 1024)
}

/// One test, so that nothing else allocates meanwhile.
#[test]
fn hostile_inputs_are_refused_without_much_memory_or_time() {
    let before = peak();
    let start = std::time::Instant::now();
    depth_bombs();
    long_lists();
    many_attributes();
    many_pieces();
    many_layers();
    long_inputs();
    let grown = peak() - before;
    assert!(grown < 512 << 20, "{} MiB", grown >> 20);
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}

const INFORM: &[u8] = b"<fipa-message act='inform'>";

const END: &[u8] = b"</fipa-message>";

fn depth_bombs() {
    let opened = |open: &[u8]| [INFORM, &open.repeat(MANY)].concat();
    for open in [
        &b"<a>"[..],
        b"<sender>",
        b"<content>",
        b"<user-defined href='x'>",
    ] {
        let fault = fault_of(opened(open));
        // A content is not descended into.
        let expected = if open == b"<content>" {
            Fault::Malformed
        } else {
            Fault::Limit
        };
        assert_eq!(fault, expected, "{open:?}");
    }
    let resolvers = b"<agent-identifier><resolvers>".repeat(MANY / 8);
    assert_eq!(
        fault_of([INFORM, b"<sender>", &resolvers].concat()),
        Fault::Limit
    );
    let closed = [&b"<a>".repeat(MANY)[..], &b"</a>".repeat(MANY)].concat();
    assert_eq!(fault_of([INFORM, &closed, END].concat()), Fault::Limit);
    let lists = [b"(".repeat(40), b")".repeat(40)].concat();
    let octets = [INFORM, b"<language>", &lists, b"</language>", END].concat();
    assert_eq!(fault_of(octets), Fault::Limit);
    // Not even a list.
    let octets = [
        INFORM,
        b"<language>",
        &b"(".repeat(MANY),
        b"</language>",
        END,
    ]
    .concat();
    assert!(decode_message(&octets.into(), &Limits::default()).is_ok());
    let nested = |depth: usize| -> Bytes {
        let agent = b"<agent-identifier><name id='a'/><resolvers>".repeat(depth);
        let ends = b"</resolvers></agent-identifier>".repeat(depth);
        [INFORM, b"<sender>", &agent, &ends, b"</sender>", END]
            .concat()
            .into()
    };
    let just = Limits {
        max_depth: 2,
        ..Limits::default()
    };
    assert!(decode_message(&nested(3), &just).is_ok());
    assert_eq!(
        decode_message(&nested(4), &just).unwrap_err().fault,
        Fault::Limit
    );
    assert!(decode_message(&nested(33), &Limits::default()).is_ok());
    assert_eq!(
        decode_message(&nested(34), &Limits::default())
            .unwrap_err()
            .fault,
        Fault::Limit
    );
}

fn long_lists() {
    for entry in [
        &b"<X-a/>"[..],
        b"<user-defined/>",
        b"<receiver><agent-identifier><name id='a'/></agent-identifier></receiver>",
    ] {
        let octets = [INFORM, &entry.repeat(70_000), END].concat();
        assert_eq!(fault_of(octets), Fault::Limit);
    }
    let urls = b"<url/>".repeat(70_000);
    let agent = [
        INFORM,
        b"<sender><agent-identifier><name id='a'/><addresses>",
        &urls,
    ]
    .concat();
    assert_eq!(fault_of(agent), Fault::Limit);
    for items in [&b"() "[..], b"a ", b"\"\"", b"#0\""] {
        let octets = [
            INFORM,
            b"<language>(",
            &items.repeat(MANY),
            b")</language>",
            END,
        ]
        .concat();
        assert_eq!(fault_of(octets), Fault::Limit);
    }
}

fn many_attributes() {
    let attributes: Vec<u8> = (0..50_000)
        .flat_map(|i| format!(" a{i}='v'").into_bytes())
        .collect();
    let tag = [b"<fipa-message act='inform'", &attributes[..], b"/>"].concat();
    assert_eq!(fault_of(tag), Fault::Limit);
    let ignored = [INFORM, b"<x", &attributes, b"/>", END].concat();
    assert_eq!(fault_of(ignored), Fault::Limit);
    let quotes = [INFORM, b"<x a=", &b"'".repeat(MANY)].concat();
    assert_eq!(fault_of(quotes), Fault::Malformed);
}

/// Each must be found out in one pass.
fn many_pieces() {
    let tail = [b"</language>", END].concat();
    for piece in [
        &b"&lt;"[..],
        b"&",
        b"<![CDATA[]]>",
        b"<![CDATA[x]]>",
        b"<!---->",
        b"<?a?>",
        b"<a></a>",
        b"<url>x</url>",
    ] {
        let octets = [INFORM, b"<language>", &piece.repeat(MANY / 8), &tail].concat();
        let _ = decode_message(&octets.into(), &Limits::default());
    }
    for piece in [
        &b"<content><![CDATA[a]]>b</content>"[..],
        b"<content><![CDATA[",
        b"<content><![CDATA[a]]></b>",
        b"<content>&</content>",
        b"<user-defined href='X-a'>&</user-defined>",
        b"<!--",
        b"<?",
        b"<a",
        b"<a b='",
        b"&;",
    ] {
        for tail in [&b""[..], END] {
            let octets = Bytes::from([INFORM, &piece.repeat(MANY / 16), tail].concat());
            let _ = decode_message(&octets, &Limits::default());
        }
    }
}

fn many_layers() {
    let layers = |count: usize| {
        [
            b"<envelope>",
            &b"<params/>".repeat(count)[..],
            b"</envelope>",
        ]
        .concat()
    };
    let limits = Limits {
        max_layers: 3,
        ..Limits::default()
    };
    assert!(decode_envelope(&layers(3).into(), &limits).is_ok());
    assert_eq!(
        decode_envelope(&layers(4).into(), &limits)
            .unwrap_err()
            .fault,
        Fault::Limit
    );
    assert_eq!(envelope_fault(layers(MANY)), Fault::Limit);
}

fn long_inputs() {
    let limits = Limits {
        max_octets: 60,
        ..Limits::default()
    };
    let message = |content: usize| -> Bytes {
        [
            INFORM,
            b"<content>",
            &b"x".repeat(content),
            b"</content>",
            END,
        ]
        .concat()
        .into()
    };
    let error = decode_message(&message(1), &limits).unwrap_err();
    assert_eq!((error.fault, error.offset), (Fault::Limit, 60));
    let spaces: Bytes = [b"<fipa-message act='inform'/>", &b" ".repeat(60)[..]]
        .concat()
        .into();
    assert_eq!(
        decode_message(&spaces, &limits).unwrap_err().fault,
        Fault::Limit
    );
    let letter: Bytes = [b"<envelope><params/></envelope>", &b"x".repeat(60)[..]]
        .concat()
        .into();
    assert_eq!(
        decode_letter(&letter, &limits).unwrap_err().fault,
        Fault::Limit
    );
    let announced = "<envelope><params><payload-length>18446744073709551615</payload-length></params>\
                     </envelope>PAY";
    let (letter, used) = decode_letter_prefix(&announced.into(), &Limits::default()).unwrap();
    assert_eq!(
        (letter.payload, used),
        (Bytes::from("PAY"), announced.len())
    );
    let announced = announced.replace("18446744073709551615", "2");
    let (letter, used) =
        decode_letter_prefix(&announced.clone().into(), &Limits::default()).unwrap();
    assert_eq!(
        (letter.payload, used),
        (Bytes::from("PA"), announced.len() - 1)
    );
}
