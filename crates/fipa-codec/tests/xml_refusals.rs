//! Documents that are refused: where, and whose fault it is.

mod xml_support;

use fipa_codec::Fault;
use xml_support::{refused, refused_envelope};

/// Refused at the mark `|`, which is taken out.
fn refused_at_mark(text: &str) -> Fault {
    let offset = text.find('|').unwrap();
    let (found, fault) = refused(text.replacen('|', "", 1));
    assert_eq!(found, offset, "{text}");
    fault
}

#[test]
fn what_is_not_well_formed_is_refused_where_it_is_not() {
    let inform = "<fipa-message act='inform'>";
    for text in [
        "|not xml",
        "|",
        "  |",
        "<|fipa-mesage act='inform'/>",
        "|</fipa-message>",
        "|<1/>",
        "<?xml version='1.0'?>|",
        "<fipa-message act='inform'/>  |x",
        &format!("{inform}|</fipa-messag>"),
        &format!("{inform}<language>l|</ontology></fipa-message>"),
        &format!("{inform}<language>&|lol;</language></fipa-message>").replace("&|", "|&"),
        &format!("{inform}<language>|&#0;</language></fipa-message>"),
        &format!("{inform}<language>|&#xd800;</language></fipa-message>"),
        &format!("{inform}<language>|&#1114112;</language></fipa-message>"),
        &format!("{inform}<unknown>text |&lol; text</unknown></fipa-message>"),
        &format!("{inform}<language>|<!ELEMENT></language></fipa-message>"),
        &format!("{inform}|<name id=x/></fipa-message>"),
        &format!("{inform}|<name id/></fipa-message>"),
        &format!("{inform}|<name id='a'refid='b'/></fipa-message>"),
        &format!("{inform}<name id='a' |id='b'/></fipa-message>"),
        &format!("{inform}|<na$me/></fipa-message>"),
        &format!("{inform}<content>a</content>|"),
        &format!("{inform}<!-- |")
            .replace('|', "")
            .replacen("<!-- ", "<!-- |", 1),
        &format!("{inform}<language><![CDATA[|"),
        &format!("{inform}<language|"),
        &format!("{inform}<name id='|"),
    ] {
        assert_eq!(refused_at_mark(text), Fault::Malformed, "{text}");
    }
}

#[test]
fn what_the_standard_does_not_allow_is_refused() {
    for text in [
        "<fipa-message>|<content>x</content></fipa-message>",
        "<fipa-message act=' '>|</fipa-message>",
        "<fipa-message act='inform'/>|<fipa-message act='inform'/>",
        "<fipa-message act='inform'><content>a</content></fipa-message>\n|<fipa-message act='inform'>\
         <content>b</content></fipa-message>",
        "<fipa-message act='inform'><receiver><agent-identifier></agent-identifier>|</receiver>\
         </fipa-message>",
        "<fipa-message act='inform'><|reply-by time='soon'/></fipa-message>",
    ] {
        assert_eq!(refused_at_mark(text), Fault::Violation, "{text}");
    }
    assert_eq!(
        refused_envelope("<envelope></envelope>").1,
        Fault::Violation
    );
    let no_date =
        "<envelope><params><received><received-by value='b'/></received></params></envelope>";
    assert_eq!(refused_envelope(no_date).1, Fault::Violation);
}

#[test]
fn document_types_with_declarations_are_refused() {
    let bomb = "<?xml version='1.0'?><!DOCTYPE lolz |[<!ENTITY lol 'lol'>\
                <!ENTITY lol2 '&lol;&lol;&lol;&lol;&lol;&lol;&lol;&lol;'>]>\
                <fipa-message act='inform'><content>&lol2;</content></fipa-message>";
    assert_eq!(refused_at_mark(bomb), Fault::Unsupported);
    let external = "<!DOCTYPE r SYSTEM 'x' |[<!ENTITY % p SYSTEM 'file:///etc/passwd'>%p;]>\
                    <fipa-message act='inform'/>";
    assert_eq!(refused_at_mark(external), Fault::Unsupported);
    let inside = "<fipa-message act='inform'>|<!DOCTYPE x></fipa-message>";
    assert_eq!(refused_at_mark(inside), Fault::Malformed);
    // Without a declaration the reference is the text of somebody who does not escape.
    let undefined = "<!DOCTYPE r SYSTEM 'x'><fipa-message act='inform'><content>&lol;</content>\
                     </fipa-message>";
    assert_eq!(xml_support::read(undefined).content_str(), Some("&lol;"));
}
