//! What an AMS lets its own agents and those of other platforms do.

mod support;

use fipa_acl::{AgentId, Message, Performative};
use fipa_management::client::{self, AnswerError, agents_result};
use fipa_management::{
    AgentState, Ams, AmsAgentDescription, AmsConfig, ApDescription, DirectoryView, Origin, Reason,
    SearchConstraints,
};
use fipa_sl::Term;
use support::Town;

const AMS: &str = "ams@robot1";

fn world(allow_foreign: bool) -> (Ams, Town) {
    let config = AmsConfig {
        allow_foreign,
        max_registrations: 3,
        ..AmsConfig::new(AMS)
    };
    let town = Town::new("robot1", "tcp://robot1:1")
        .with("drive@robot1", "motor", true)
        .with("arm@robot2", "motor", false);
    (Ams::new(config), town)
}

fn description(name: &str, state: &str) -> AmsAgentDescription {
    AmsAgentDescription {
        name: Some(AgentId::new(name).address("tcp://elsewhere:1")),
        ownership: Some("ACME".into()),
        state: Some(AgentState::from(fipa_acl::Text::from(state))),
    }
}

fn request(function: &str, description: &AmsAgentDescription, from: &str) -> Message {
    let content = format!("((action {AMS} ({function} {})))", Term::from(description));
    Message::new(Performative::Request)
        .from_agent(from)
        .content(content)
}

fn refused<T>(reason: Reason) -> Result<T, AnswerError> {
    Err(AnswerError::Refused(reason))
}

fn listed(
    ams: &mut Ams,
    town: &mut Town,
    template: &AmsAgentDescription,
) -> Vec<AmsAgentDescription> {
    let request = client::ams_search_request(&AMS.into(), template, &SearchConstraints::all());
    let answer = ams
        .handle(Origin::Foreign, &request.from_agent("x@y"), town)
        .unwrap();
    agents_result(&answer).unwrap()
}

#[test]
fn an_agent_of_ours_may_register_one_that_is_reached_elsewhere() {
    let (mut ams, mut town) = world(false);
    let device = description("device@robot1", "waiting");
    let register = request("register", &device, "drive@robot1");
    let answer = ams.handle(Origin::Local, &register, &mut town).unwrap();
    assert_eq!(client::done(&answer), Ok(()));
    assert_eq!(town.addresses["device@robot1"], ["tcp://elsewhere:1"]);
    assert_eq!(
        listed(&mut ams, &mut town, &device),
        std::slice::from_ref(&device)
    );
    let waiting = AmsAgentDescription {
        state: Some(AgentState::Waiting),
        ..AmsAgentDescription::default()
    };
    assert_eq!(
        listed(&mut ams, &mut town, &waiting),
        std::slice::from_ref(&device)
    );

    let moved = request(
        "modify",
        &description("device@robot1", "transit"),
        "drive@robot1",
    );
    let answer = ams.handle(Origin::Local, &moved, &mut town).unwrap();
    assert_eq!(client::done(&answer), Ok(()));
    assert_eq!(listed(&mut ams, &mut town, &waiting), []);

    let leave = client::ams_deregister_request(&AMS.into(), &"device@robot1".into());
    let answer = ams
        .handle(Origin::Local, &leave.from_agent("drive@robot1"), &mut town)
        .unwrap();
    assert_eq!(client::done(&answer), Ok(()));
    assert!(town.find("device@robot1").is_none());
}

#[test]
fn an_attached_agent_is_described_by_itself_only() {
    let (mut ams, mut town) = world(true);
    let suspended = description("drive@robot1", "suspended");
    for (origin, from) in [
        (Origin::Local, "other@robot1"),
        (Origin::Foreign, "drive@robot1"),
    ] {
        let answer = ams
            .handle(origin, &request("modify", &suspended, from), &mut town)
            .unwrap();
        assert_eq!(
            client::done(&answer),
            refused(Reason::Unauthorised),
            "{from}"
        );
    }
    let own = request("modify", &suspended, "drive@robot1");
    let answer = ams.handle(Origin::Local, &own, &mut town).unwrap();
    assert_eq!(client::done(&answer), Ok(()));
    let [drive] = <[_; 1]>::try_from(listed(&mut ams, &mut town, &Default::default())).unwrap();
    assert_eq!(drive.state, Some(AgentState::Suspended));
    // Its addresses are those of the directory, whatever it says.
    assert_eq!(drive.name.unwrap().addresses, ["tcp://robot1:1"]);
    ams.agent_gone("drive@robot1");
    let [drive] = <[_; 1]>::try_from(listed(&mut ams, &mut town, &Default::default())).unwrap();
    assert_eq!(drive.state, Some(AgentState::Active));
}

#[test]
fn a_stranger_that_is_allowed_takes_no_name_of_ours() {
    let (mut ams, mut town) = world(true);
    for name in ["drive@robot1", "new@robot1", "new@ROBOT1"] {
        let answer = ams.handle(
            Origin::Foreign,
            &request("register", &description(name, "active"), name),
            &mut town,
        );
        assert_eq!(
            client::done(&answer.unwrap()),
            refused(Reason::Unauthorised),
            "{name}"
        );
    }
    let other = request("register", &description("a@y", "active"), "b@y");
    let answer = ams.handle(Origin::Foreign, &other, &mut town).unwrap();
    assert_eq!(client::done(&answer), refused(Reason::Unauthorised));
    for (n, name) in ["a@y", "b@y", "c@y", "d@y"].into_iter().enumerate() {
        let register = request("register", &description(name, "active"), name);
        let answer = ams.handle(Origin::Foreign, &register, &mut town).unwrap();
        assert_eq!(client::done(&answer).is_ok(), n < 3, "{name}");
    }
}

#[test]
fn what_is_wrong_is_told() {
    let (mut ams, mut town) = world(true);
    let mut reason = |content: &str| {
        let request = Message::new(Performative::Request)
            .from_agent("a@y")
            .content(content.to_owned());
        client::done(&ams.handle(Origin::Foreign, &request, &mut town).unwrap())
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        reason("((action ams (register (ams-agent-description :state active))))"),
        "refused: the ams-agent-description needs a parameter :name"
    );
    assert_eq!(
        reason(
            "((action ams (register (ams-agent-description :name (agent-identifier :name a@y) :age 4))))"
        ),
        "refused: no ams-agent-description has a parameter :age"
    );
    assert_eq!(
        reason("((action ams (register)))"),
        "refused: the argument ams-agent-description is missing"
    );
    assert_eq!(
        reason("((action ams (get-description now)))"),
        "refused: there are too many arguments"
    );
    assert_eq!(
        reason(
            "((action ams (modify (ams-agent-description :name (agent-identifier :name a@y)))))"
        ),
        "failed: the agent is not registered"
    );
    assert_eq!(
        reason("((register a))"),
        "not understood: it cannot read the content"
    );
    assert_eq!(reason(""), "not understood: it cannot read the content");
}

#[test]
fn a_tool_that_subscribes_is_told_that_it_cannot() {
    let (mut ams, mut town) = world(false);
    let subscribe = Message::new(Performative::Subscribe)
        .from_agent("RMA@p")
        .content("platform-events");
    let answer = ams.handle(Origin::Foreign, &subscribe, &mut town).unwrap();
    assert_eq!(answer.content_str(), Some("((unsupported-act subscribe))"));
    let inform = Message::new(Performative::Inform).from_agent("RMA@p");
    assert_eq!(ams.handle(Origin::Foreign, &inform, &mut town), None);
}

#[test]
fn the_platform_as_jade_tells_it_is_read() {
    let term: Term = r#"(ap-description :name "\"platA\"" :ap-services (sequence
        (ap-service :name fipa.mts.mtp.http.std :type fipa.mts.mtp.http.std
            :addresses (sequence http://127.0.0.1:7778/acc))))"#
        .parse()
        .unwrap();
    let platform = ApDescription::try_from(&term).unwrap();
    assert_eq!(platform.name, "platA");
    // Ordinary agents are listed there without addresses.
    let bare = AmsAgentDescription {
        name: Some("echo@platA".into()),
        ..AmsAgentDescription::default()
    };
    let agent = bare.at(&platform).name.unwrap();
    assert_eq!(agent.addresses, ["http://127.0.0.1:7778/acc"]);
    let own = description("a@b", "active").at(&platform).name.unwrap();
    assert_eq!(own.addresses, ["tcp://elsewhere:1"]);
}

#[test]
fn what_the_platform_tells_about_itself_is_one_term() {
    let (_, town) = world(false);
    assert_eq!(
        Term::from(&town.description()).to_string(),
        "(ap-description :name robot1 :ap-services (sequence (ap-service \
         :name fipa.mts.mtp.http.std :type fipa.mts.mtp.http.std \
         :addresses (sequence tcp://robot1:1))))"
    );
}
