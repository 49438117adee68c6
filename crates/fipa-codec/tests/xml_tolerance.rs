//! What differs from the messages that are written, and is read all the same.

mod xml_support;

use fipa_acl::{AgentId, Expression, Message, Performative};
use fipa_codec::xml::is_envelope;
use xml_support::{read, read_envelope};

fn inform() -> Message {
    Message::new(Performative::Inform)
}

fn with(inner: &str) -> Message {
    read(format!(
        "<fipa-message act=\"inform\">{inner}</fipa-message>"
    ))
}

fn base(inner: &str) -> fipa_acl::Slots {
    read_envelope(format!(
        "<envelope><params index=\"1\">{inner}</params></envelope>"
    ))
    .base
}

#[test]
fn names_and_acts_are_read_in_any_case_and_with_any_prefix() {
    let text = "<f:FIPA-Message xmlns:f='u' ACT='x' act = ' QUERY-if '><f:Content >c</f:Content \n>\
                <Language>l</Language></f:FIPA-Message>";
    assert_eq!(
        read(text),
        Message::new(Performative::QueryIf)
            .content("c")
            .language("l")
    );
    assert_eq!(read("<fipa-message act='Shout'/>"), Message::new("Shout"));
}

#[test]
fn agents_are_read_in_all_forms() {
    let agent = AgentId::new("a").address("u");
    for name in [
        "id=\"a\"/>",
        "refid='a'/>",
        "value=\"a\"/>",
        "> a\n</name>",
        "id='b'>a</name>",
    ] {
        for url in [
            "href='u'/>",
            "value='u'/>",
            ">u</url>",
            "><![CDATA[u]]></url>",
            "> &#x75; </url>",
        ] {
            let identifier = format!(
                "<agent-identifier><name {name}<addresses><url {url}<url/></addresses>\
                 </agent-identifier>",
            );
            let message = with(&format!("<sender>{identifier}</sender>"));
            assert_eq!(message.sender, Some(agent.clone()), "{identifier}");
            let slots = base(&format!("<from>{identifier}</from>"));
            assert_eq!(slots.from, Some(agent.clone()), "{identifier}");
        }
    }
}

#[test]
fn agents_are_read_grouped_and_repeated() {
    let [a, b, c] = ["a", "b", "c"]
        .map(|name| format!("<agent-identifier><name id='{name}'/></agent-identifier>"));
    let three = [AgentId::new("a"), AgentId::new("b"), AgentId::new("c")];
    for text in [
        format!("<r>{a}{b}</r> <r>{c}</r>"),
        format!("<r>{a}</r><r>{b}</r><r>{c}</r>"),
        format!("<r>{a}{b}{c}</r><r/>"),
    ] {
        let named = |name: &str| {
            text.replace("<r", &format!("<{name}"))
                .replace("</r>", &format!("</{name}>"))
        };
        assert_eq!(with(&named("receiver")).receiver, three);
        assert_eq!(with(&named("reply-to")).reply_to, three);
        assert_eq!(base(&named("to")).to, three);
        assert_eq!(base(&named("intended-receiver")).intended_receiver, three);
    }
}

#[test]
fn a_sender_that_was_never_set_is_none() {
    let text =
        "<sender><agent-identifier><name id='agent_id:undefined'/></agent-identifier></sender>";
    assert_eq!(with(text).sender, None);
}

#[test]
fn values_are_read_in_all_forms() {
    for text in [
        "<ontology>o</ontology>",
        "<ontology href='o'/>",
        "<ontology value='o'></ontology>",
        "<ontology href='x'>o</ontology>",
        "<ontology href='o'>\n</ontology>",
        "<ontology><!-- c -->o<?i?></ontology>",
        "<ontology><x>y</x>o</ontology>",
    ] {
        assert_eq!(with(text), inform().ontology("o"), "{text}");
    }
    assert_eq!(
        with("<ontology/><language></language><reply-by time=''/>"),
        inform()
    );
    assert_eq!(
        with("<ontology> o </ontology>").ontology,
        Some(Expression::String(" o ".into()))
    );
    assert_eq!(with("<content href='c'/>"), inform().content("c"));
}

#[test]
fn expressions_are_read_as_what_the_text_stands_for() {
    let list = with("<language>(a &quot;b c&quot; (1))</language>")
        .language
        .unwrap();
    assert!(matches!(&list, Expression::List(items) if items.len() == 3));
    for text in [
        "(a", "(a))", "a)", ")", "()(", "#3\"abc", "(#9\"a)", "\"(\"",
    ] {
        let message = with(&format!("<language>{text}</language>"));
        assert_eq!(
            message.language,
            Some(Expression::String(text.into())),
            "{text}"
        );
    }
}

#[test]
fn an_element_wins_over_the_attribute_and_an_empty_attribute_is_none() {
    let head = "<fipa-message act='inform' conversation-id=";
    let read = |tail: &str| read(format!("{head}{tail}")).conversation_id;
    assert_eq!(read("'a'/>"), Some("a".into()));
    assert_eq!(
        read("'a'><conversation-id>b</conversation-id></fipa-message>"),
        Some("b".into())
    );
    assert_eq!(read("'&lt;&#65;&gt;'/>"), Some("<A>".into()));
    assert_eq!(read("''/>"), None);
}

#[test]
fn user_defined_parameters_are_read_in_all_forms() {
    let expected = inform().user_defined("a", "b");
    for text in [
        "<user-defined href='X-a' type='string'>b</user-defined>",
        "<user-defined href='x-X-a'>b</user-defined>",
        "<user-defined href='a' value='b'/>",
        "<X-a>b</X-a>",
        "<n:x-a>b</n:x-a>",
        "<user-defined>without a name</user-defined><X-a>b</X-a>",
    ] {
        assert_eq!(with(text), expected, "{text}");
        assert_eq!(
            base(text).user_defined,
            [("a".into(), "b".into())],
            "{text}"
        );
    }
}

#[test]
fn what_stands_around_a_message_is_ignored() {
    let message = "<fipa-message act='inform'/>";
    for head in [
        "",
        "\u{feff}",
        " \r\n",
        "<?xml version=\"1.0\" encoding='UTF-8'?>\n",
        "<!-- > -- --><?pi <a> ?>",
        "<!DOCTYPE fipa-message SYSTEM \"fipa.acl.rep.xml.std>[.dtd\" >",
        "<?xml version='1.0'?><!DOCTYPE fipa-message PUBLIC '-//FIPA//x' \"y\">\n",
    ] {
        assert_eq!(read(format!("{head}{message}\r\n\t ")), inform(), "{head}");
        assert!(!is_envelope(format!("{head}{message}").as_bytes()));
        assert!(
            is_envelope(format!("{head}<Envelope>").as_bytes()),
            "{head}"
        );
    }
    assert!(!is_envelope(b"") && !is_envelope(b"(inform)") && !is_envelope(b"<envelopes>"));
}

#[test]
fn text_that_is_not_utf_8_is_read_with_replacement_characters() {
    let text = b"<fipa-message act='inform'><sender><agent-identifier><name id='\xff' /></agent-identifier>\
                 </sender><language>a\xfe</language></fipa-message>";
    let message = read(text);
    assert_eq!(message.sender.unwrap().name, *"\u{fffd}");
    assert_eq!(message.language, Some("a\u{fffd}".into()));
}
