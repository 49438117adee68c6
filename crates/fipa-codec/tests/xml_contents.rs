//! Contents are octets: they are read exactly, whoever wrote them and however.

mod xml_support;

use fipa_acl::{Message, Performative};
use fipa_codec::Limits;
use fipa_codec::xml::{decode_message, decode_message_prefix};
use xml_support::{octets, read};

fn inform() -> Message {
    Message::new(Performative::Inform)
}

fn with(inner: &str) -> Message {
    read(format!(
        "<fipa-message act=\"inform\">{inner}</fipa-message>"
    ))
}

fn content_of(inner: &str) -> String {
    let message = with(&format!("<content>{inner}</content>"));
    message.content_str().unwrap_or_default().to_owned()
}

#[test]
fn contents_are_read_exactly() {
    for (text, content) in [
        ("a\r\nb\rc\n", "a\r\nb\rc\n"),
        (
            " &lt;&gt;&amp;&quot;&apos;&#10;&#x1F680; ",
            " <>&\"'\n\u{1f680} ",
        ),
        ("<![CDATA[a]]>b]]>", "a]]>b"),
        ("<![CDATA[<a>&amp;</a>]]>", "<a>&amp;</a>"),
        ("x<![CDATA[<]]>y<![CDATA[&]]>", "x<y&"),
        ("<![CDATA[a]]>\n", "a\n"),
        ("<![CDATA[a]]> <![CDATA[b]]>", "a]]> <![CDATA[b"),
        ("a<!-- b -->c", "ac"),
        ("&#1;", "\u{1}"),
        ("", ""),
        ("<![CDATA[]]>", ""),
    ] {
        assert_eq!(content_of(text), content, "{text}");
    }
    let octets =
        b"<fipa-message act='inform'><content><![CDATA[\xff\x00]]></content></fipa-message>";
    assert_eq!(read(octets).content.unwrap(), &b"\xff\0"[..]);
}

#[test]
fn text_that_jade_did_not_escape_is_read() {
    for content in [
        "a & b",
        "a < b && c > d",
        "<tag>text",
        "<a/>",
        "&nothing;",
        "</content>",
        "a</content>b & <content>c",
        "<fipa-message act=\"inform\"><content>x</content></fipa-message>",
        "<!-- ",
        "<![CDATA[",
        "&lt; stays",
    ] {
        let text = format!(
            "<fipa-message act=\"INFORM\" >\n\t<content>{content}</content>\n\
             \t<language>l</language>\n</fipa-message>\n & ",
        );
        let text = text.trim_end_matches(" & ");
        let expected = match content {
            "&lt; stays" => "< stays",
            other => other,
        };
        assert_eq!(
            read(text),
            inform().content(expected.to_owned()).language("l"),
            "{content}"
        );
    }
    let message = with(
        "<user-defined href='X-a'>1 & 2</user-defined><user-defined href='X-b'/>\
                        <X-c><d></X-c><ontology>?a=1&b=2</ontology>",
    );
    let expected = inform()
        .user_defined("a", "1 & 2")
        .user_defined("b", "")
        .user_defined("c", "<d>")
        .ontology("?a=1&b=2");
    assert_eq!(message, expected);
}

#[test]
fn a_message_within_a_section_within_a_message_is_read() {
    let inner = "<fipa-message act=\"inform\"><content><![CDATA[x]]></content></fipa-message>";
    assert_eq!(content_of(&format!("<![CDATA[{inner}]]>")), inner);
}

#[test]
fn the_text_of_one_message_does_not_reach_into_the_next() {
    let one = "<fipa-message act='inform'><content>a & b</content></fipa-message>";
    let two = octets([one, one].concat());
    let (message, used) = decode_message_prefix(&two, &Limits::default()).unwrap();
    assert_eq!((message, used), (inform().content("a & b"), one.len()));
}

#[test]
fn the_ways_of_jade_to_write_octets_are_undone() {
    let content = inform().content(vec![0, 1, 2, 3, 4, 5, 255]);
    let base64 = "<content>AAECAwQF/w==</content>";
    for parameter in [
        "<X-JADE-Encoding>Base64</X-JADE-Encoding>",
        "<user-defined href='X-JADE-Encoding' type='string'>Base64</user-defined>",
        "<user-defined href='JADE-encoding'>base64</user-defined>",
    ] {
        assert_eq!(with(&format!("{parameter}{base64}")), content);
        assert_eq!(with(&format!("{base64}{parameter}")), content);
        assert_eq!(with(parameter), inform());
    }
    let parameter = "<X-JADE-Encoding>Base64</X-JADE-Encoding>";
    let in_lines = "<content>\nAAEC\r\nAwQF\n/w\n</content>";
    assert_eq!(with(&format!("{parameter}{in_lines}")), content);
    let wrong = with(&format!("{parameter}<content>not so</content>"));
    assert_eq!(
        wrong,
        inform()
            .content("not so")
            .user_defined("JADE-Encoding", "Base64")
    );
}

#[test]
fn values_share_the_buffer_of_the_input() {
    let long = "long".repeat(8);
    for content in ["text", "<![CDATA[text]]>", "text & more", "te<xt", "href"] {
        let input = octets(format!(
            "<fipa-message act='inform'><content>{content}</content><ontology>{long}</ontology>\
             <protocol href='{long}'/></fipa-message>",
        ));
        let within = input.as_ptr_range();
        let message = decode_message(&input, &Limits::default()).unwrap();
        let values = [
            message.content.unwrap().as_ptr(),
            message.ontology.unwrap().as_str().unwrap().as_ptr(),
            message.protocol.unwrap().as_ptr(),
        ];
        assert!(
            values.iter().all(|value| within.contains(value)),
            "{content}"
        );
    }
}
