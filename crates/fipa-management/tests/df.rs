//! What a DF finds, grants and refuses, on a simulated clock.

mod support;

use std::time::Duration;

use fipa_acl::{FipaTime, Message, Performative};
use fipa_directory::Now;
use fipa_management::client::{self, AnswerError, notification, search_result};
use fipa_management::{
    Df, DfAgentDescription, DfConfig, DirectoryView, KnownAgent, Origin, Reason, SearchConstraints,
    ServiceDescription,
};
use support::{Town, only, sent};

const DF: &str = "df@robot1";

struct World {
    df: Df,
    town: Town,
    now: Now,
}

impl World {
    fn new() -> World {
        World::with(DfConfig::new(DF, "u"))
    }

    fn with(config: DfConfig) -> World {
        World {
            df: Df::new(config),
            town: Town::new("robot1", "tcp://robot1:1"),
            now: Now {
                mono: Duration::from_secs(50),
                unix_millis: 1_795_341_600_000,
            },
        }
    }

    fn ask(&mut self, origin: Origin, request: Message) -> Message {
        self.df.handle(self.now, origin, &request, &self.town);
        only(&mut self.df)
    }

    fn register(&mut self, description: &str) -> Result<DfAgentDescription, AnswerError> {
        self.perform("register", description)
    }

    /// Lets an agent of ours ask for this function with a description in SL.
    fn perform(
        &mut self,
        function: &str,
        description: &str,
    ) -> Result<DfAgentDescription, AnswerError> {
        let content = format!("((action {DF} ({function} {description})))");
        let request = Message::new(Performative::Request).from_agent("a@robot1");
        client::registered(&self.ask(Origin::Local, request.content(content)))
    }

    fn search(&mut self, template: &str, constraints: &str) -> Vec<String> {
        let content =
            format!("((action {DF} (search {template} (search-constraints {constraints}))))");
        let request = Message::new(Performative::Request).from_agent("a@robot1");
        let answer = self.ask(Origin::Foreign, request.content(content));
        let found = search_result(&answer).unwrap().into_iter();
        found
            .map(|found| found.name.unwrap().name.to_string())
            .collect()
    }

    fn found(&mut self, template: &str) -> Vec<String> {
        self.search(
            &format!("(df-agent-description {template})"),
            ":max-results -1",
        )
    }

    fn pass(&mut self, span: Duration) {
        self.now = self.now.plus(span);
        self.df.handle_timeout(self.now);
    }

    fn subscribe(&mut self, template: &DfAgentDescription) {
        let subscribe =
            client::df_subscribe_request(&DF.into(), template, &SearchConstraints::all())
                .from_agent("watch@robot2")
                .conversation_id("s");
        self.df
            .handle(self.now, Origin::Foreign, &subscribe, &self.town);
    }
}

fn refused(reason: Reason) -> Result<DfAgentDescription, AnswerError> {
    Err(AnswerError::Refused(reason))
}

fn failed(reason: Reason) -> Result<DfAgentDescription, AnswerError> {
    Err(AnswerError::Failed(reason))
}

#[test]
fn every_part_of_a_template_must_match() {
    let mut world = World::new();
    let weather = "(df-agent-description :name (agent-identifier :name w@r) \
        :services (set (service-description :name Rome :type Weather :ownership ACME \
            :languages (set fipa-sl0) :properties (set (property :name country :value Italy) \
                (property :name days :value 5))) \
            (service-description :name News :type news)) \
        :protocols (set fipa-request fipa-query) :ontologies (set weather geo) :scope (set global))";
    world.register(weather).unwrap();
    let matching = [
        "",
        ":name (agent-identifier :name w@r :addresses (sequence tcp://x:1))",
        ":services (set)",
        ":services (set (service-description))",
        ":services (set (service-description :type WEATHER))",
        ":services (sequence (service-description :type weather) (service-description :name news))",
        ":services (set (service-description :type weather :name rome :ownership acme))",
        ":services (set (service-description :properties (set (property :name country))))",
        ":services (set (service-description :properties (set (property :name days :value 5))))",
        ":services (set (service-description :properties (set (property :name days :value \"5\"))))",
        ":protocols (set FIPA-query)",
        ":ontologies (set geo weather) :protocols (set fipa-request) :scope (set global)",
    ];
    for template in matching {
        assert_eq!(world.found(template), ["w@r"], "{template}");
    }
    let others = [
        ":name (agent-identifier :name v@r)",
        ":services (set (service-description :type climate))",
        ":services (set (service-description :type weather) (service-description :type climate))",
        // Not by two services together.
        ":services (set (service-description :type weather :name news))",
        ":services (set (service-description :properties (set (property :name country :value Spain))))",
        ":services (set (service-description :properties (set (property :name colour))))",
        ":services (set (service-description :languages (set fipa-sl1)))",
        ":protocols (set fipa-request fipa-propose)",
        ":ontologies (set geo food)",
        ":languages (set fipa-sl0)",
        ":scope (set local)",
        ":lease-time 20310203T040506789Z",
    ];
    for template in others {
        assert_eq!(world.found(template), [""; 0], "{template}");
    }
}

#[test]
fn as_many_are_found_as_are_wanted_in_the_order_of_their_registration() {
    let mut world = World::with(DfConfig {
        max_foreign_results: 4,
        ..DfConfig::new(DF, "u")
    });
    for name in ["e", "d", "c", "b", "a"] {
        let description = format!("(df-agent-description :name (agent-identifier :name {name}))");
        world.register(&description).unwrap();
    }
    let all = "(df-agent-description)";
    assert_eq!(world.search(all, ""), ["e"]);
    assert_eq!(world.search(all, ":max-results 0"), [""; 0]);
    assert_eq!(world.search(all, ":max-results 3"), ["e", "d", "c"]);
    assert_eq!(world.search(all, ":max-results -1"), ["e", "d", "c", "b"]);
    assert_eq!(
        world.search(all, ":max-results 1000000"),
        ["e", "d", "c", "b"]
    );
}

#[test]
fn who_is_given_fewer_than_there_are_and_wanted_more_is_told() {
    let mut world = World::with(DfConfig {
        max_results: 4,
        max_foreign_results: 2,
        ..DfConfig::new(DF, "u")
    });
    let names = ["a", "b", "c", "d"];
    for name in names {
        let description = format!("(df-agent-description :name (agent-identifier :name {name}))");
        world.register(&description).unwrap();
    }
    for (origin, wanted, given, more) in [
        (Origin::Local, -1, 4, false),
        (Origin::Foreign, -1, 2, true),
        (Origin::Foreign, 3, 2, true),
        (Origin::Foreign, 2, 2, false),
        (Origin::Foreign, 1, 1, false),
    ] {
        let constraints = SearchConstraints {
            max_results: Some(wanted),
            ..SearchConstraints::default()
        };
        let (df, all) = (DF.into(), DfAgentDescription::default());
        let search = client::df_search_request(&df, &all, &constraints).from_agent("me");
        let answer = world.ask(origin, search);
        let found = client::search_result(&answer).unwrap();
        let found = found.iter().map(|d| &*d.name.as_ref().unwrap().name);
        let found: Vec<&str> = found.collect();
        assert_eq!(found, names[..given], "{origin:?} {wanted}");
        assert_eq!(client::has_more(&answer), more, "{origin:?} {wanted}");
        let subscribe = client::df_subscribe_request(&df, &all, &constraints)
            .from_agent("me")
            .conversation_id("c");
        let told = world.ask(origin, subscribe);
        assert_eq!(client::notification(&told).unwrap().len(), given);
        assert_eq!(client::has_more(&told), more, "{origin:?} {wanted}");
    }
}

#[test]
fn a_modified_description_takes_the_place_of_the_other() {
    let mut world = World::new();
    let of_type = |kind: &str| {
        format!(
            "(df-agent-description :name (agent-identifier :name a) \
             :services (set (service-description :name s :type {kind})))"
        )
    };
    let template = |kind: &str| format!(":services (set (service-description :type {kind}))");
    assert_eq!(
        world.perform("modify", &of_type("x")),
        failed(Reason::NotRegistered)
    );
    world.register(&of_type("x")).unwrap();
    world.perform("modify", &of_type("y")).unwrap();
    assert_eq!(world.found(&template("x")), [""; 0]);
    assert_eq!(world.found(&template("y")), ["a"]);
    assert_eq!(
        world.register(&of_type("z")),
        failed(Reason::AlreadyRegistered)
    );
    world
        .perform(
            "deregister",
            "(df-agent-description :name (agent-identifier :name a))",
        )
        .unwrap();
    assert_eq!(world.found(&template("y")), [""; 0]);
}

#[test]
fn what_is_wrong_with_a_description_is_told() {
    let mut world = World::new();
    let of = |rest: &str| format!("(df-agent-description :name (agent-identifier :name a) {rest})");
    let missing = |object: &str, parameter: &str| {
        refused(Reason::MissingParameter {
            object: object.into(),
            parameter: parameter.into(),
        })
    };
    assert_eq!(
        world.register(&of(":services (set (service-description :name s))")),
        missing("service-description", "type")
    );
    assert_eq!(
        world.register(&of(":services (set (service-description :type t))")),
        missing("service-description", "name")
    );
    assert_eq!(
        world.register("(df-agent-description :name (agent-identifier :addresses (sequence)))"),
        missing("agent-identifier", "name")
    );
    assert_eq!(
        world.register(&of(":colour blue")),
        refused(Reason::UnexpectedParameter {
            object: "df-agent-description".into(),
            parameter: "colour".into()
        })
    );
    let search = format!(
        "((action {DF} (search {} (search-constraints))))",
        of(":colour blue")
    );
    let request = Message::new(Performative::Request)
        .from_agent("a@robot1")
        .content(search);
    assert_eq!(
        world.ask(Origin::Local, request).performative,
        Performative::Refuse
    );
    assert_eq!(
        world.register(&of(":lease-time tomorrow")),
        refused(Reason::UnrecognisedParameterValue {
            parameter: "lease-time".into(),
            value: "tomorrow".into()
        })
    );
    assert_eq!(
        world.register("(set)"),
        refused(Reason::MissingArgument("df-agent-description".into()))
    );
    assert_eq!(
        world.register(&format!("{} extra", of(""))),
        refused(Reason::UnexpectedArgumentCount)
    );
    // What is marked as foreign to the ontology is let through, as is the value of a property.
    let odd = ":X-colour blue :services (set (service-description :name s :type t :properties \
        (set (property :name p :value (df-agent-description :any thing)))))";
    assert!(world.register(&of(odd)).is_ok());
}

#[test]
fn leases_expire() {
    let mut world = World::new();
    let of = |name: &str, lease: &str| {
        format!("(df-agent-description :name (agent-identifier :name {name}) {lease})")
    };
    let at = |world: &World, seconds: i64| {
        let time = FipaTime::from_unix_millis(world.now.unix_millis + seconds * 1000);
        (time, format!(":lease-time {}", time.to_token().unwrap()))
    };
    let (until, lease) = at(&world, 60);
    assert_eq!(
        world.register(&of("a", &lease)).unwrap().lease_time,
        Some(until)
    );
    // A span is answered by the point in time that it means.
    let (until, _) = at(&world, 30);
    let granted = world
        .register(&of("b", ":lease-time +00000000T000030000"))
        .unwrap();
    assert_eq!(granted.lease_time, Some(until));
    world.register(&of("c", "")).unwrap();
    let (_, past) = at(&world, -1);
    world.register(&of("d", &past)).unwrap();
    assert_eq!(world.found(""), ["a", "b", "c"]);
    assert_eq!(
        world.df.poll_timeout(),
        Some(world.now.mono + Duration::from_secs(30))
    );

    world.pass(Duration::from_millis(29_999));
    assert_eq!(world.found(""), ["a", "b", "c"]);
    world.pass(Duration::from_millis(1));
    assert_eq!(world.found(""), ["a", "c"]);
    let (_, longer) = at(&world, 100);
    world.perform("modify", &of("a", &longer)).unwrap();
    world.pass(Duration::from_secs(99));
    assert_eq!(world.found(""), ["a", "c"]);
    world.pass(Duration::from_secs(1));
    assert_eq!(world.found(""), ["c"]);
    assert_eq!(world.df.poll_timeout(), None);
}

#[test]
fn an_expired_lease_does_not_match_even_before_the_timer_is_served() {
    let mut world = World::new();
    let lease = ":lease-time +00000000T000030000";
    world
        .register(&format!(
            "(df-agent-description :name (agent-identifier :name a) {lease})"
        ))
        .unwrap();
    world.now = world.now.plus(Duration::from_secs(31));
    assert_eq!(world.found(""), [""; 0]);
}

#[test]
fn a_df_may_grant_less_than_is_wanted() {
    let mut world = World::with(DfConfig {
        max_lease: Some(Duration::from_secs(60)),
        ..DfConfig::new(DF, "u")
    });
    let granted = world
        .register("(df-agent-description :name (agent-identifier :name a))")
        .unwrap();
    let until = FipaTime::from_unix_millis(world.now.unix_millis + 60_000);
    assert_eq!(granted.lease_time, Some(until));
    world.pass(Duration::from_secs(60));
    assert!(world.df.is_empty());
}

#[test]
fn subscribers_are_told_when_a_lease_expires_and_when_an_agent_is_gone() {
    let mut world = World::new();
    world.subscribe(&DfAgentDescription::default().service(ServiceDescription::of_type("t")));
    let of = |name: &str, lease: &str| {
        let services = ":services (set (service-description :name s :type t))";
        format!(
            "((action {DF} (register (df-agent-description :name (agent-identifier :name {name}) {services} {lease}))))"
        )
    };
    for content in [of("a", ":lease-time +00000000T000030000"), of("b", "")] {
        let request = Message::new(Performative::Request)
            .from_agent("a@robot1")
            .content(content);
        world
            .df
            .handle(world.now, Origin::Local, &request, &world.town);
    }
    let told = |world: &mut World| {
        let messages = sent(&mut world.df).into_iter();
        let told = messages.filter_map(|message| notification(&message).ok());
        told.map(|mut items| {
            let item = items.remove(0);
            (item.name.unwrap().name.to_string(), item.services.len())
        })
        .collect::<Vec<_>>()
    };
    assert_eq!(told(&mut world), [("a".to_owned(), 1), ("b".to_owned(), 1)]);
    world.pass(Duration::from_secs(30));
    assert_eq!(told(&mut world), [("a".to_owned(), 0)]);
    let gone = |name: &'static str| KnownAgent {
        name,
        kind: "agent",
        local: false,
    };
    world.df.agent_gone(gone("b"));
    assert_eq!(told(&mut world), [("b".to_owned(), 0)]);
    assert!(world.df.is_empty());
    // A subscriber that is gone is told nothing any more.
    world.df.agent_gone(gone("watch@robot2"));
    let request = Message::new(Performative::Request)
        .from_agent("a@robot1")
        .content(of("c", ""));
    world
        .df
        .handle(world.now, Origin::Local, &request, &world.town);
    assert_eq!(told(&mut world), []);
}

#[test]
fn a_subscriber_is_told_what_comes_to_match_and_what_ceases_to() {
    let mut world = World::new();
    world.subscribe(&DfAgentDescription::default().service(ServiceDescription::of_type("t")));
    let mut told = |function: &str, kind: &str| {
        let content = format!(
            "((action {DF} ({function} (df-agent-description :name (agent-identifier :name a) \
             :services (set (service-description :name s :type {kind}))))))"
        );
        let request = Message::new(Performative::Request)
            .from_agent("a@robot1")
            .content(content);
        world
            .df
            .handle(world.now, Origin::Local, &request, &world.town);
        let messages = sent(&mut world.df).into_iter();
        let mut items = messages
            .filter_map(|message| notification(&message).ok())
            .flatten();
        items.next().map(|item| item.services.len())
    };
    assert_eq!(told("register", "u"), None);
    assert_eq!(told("modify", "v"), None);
    assert_eq!(told("modify", "t"), Some(1));
    assert_eq!(told("modify", "u"), Some(0));
    assert_eq!(told("deregister", "u"), None);
}

#[test]
fn agents_of_the_directory_are_found_without_having_registered() {
    let mut world = World::new();
    world.town = Town::new("robot1", "tcp://robot1:1")
        .with("drive@robot1", "motor", true)
        .with("arm@robot2", "motor", false)
        .with("eye@robot2", "camera", false);
    let motors = ":services (set (service-description :type MOTOR))";
    assert_eq!(world.found(motors), ["arm@robot2", "drive@robot1"]);
    assert_eq!(
        world.found(":name (agent-identifier :name eye@robot2)"),
        ["eye@robot2"]
    );
    assert_eq!(
        world.found(":services (set (service-description :name eye))"),
        ["eye@robot2"]
    );
    assert_eq!(world.found(":ontologies (set o)"), [""; 0]);
    // Who has registered is what it says it is.
    let description = "(df-agent-description :name (agent-identifier :name drive@robot1) \
        :services (set (service-description :name d :type wheels)))";
    world.register(description).unwrap();
    assert_eq!(world.found(motors), ["arm@robot2"]);
    assert_eq!(
        world.found(""),
        ["drive@robot1", "arm@robot2", "eye@robot2"]
    );
}

#[test]
fn subscribers_are_told_what_comes_into_the_directory_and_leaves_it() {
    let mut world = World::new();
    world.town = Town::new("robot1", "tcp://robot1:1").with("arm@robot2", "motor", false);
    world.subscribe(&DfAgentDescription::default().service(ServiceDescription::of_type("motor")));
    let items = notification(&only(&mut world.df)).unwrap();
    assert_eq!(
        items[0].name.as_ref().unwrap().addresses,
        ["tcp://robot1:1"]
    );
    let known = world.town.find("arm@robot2").unwrap();
    world.df.agent_known(known, &world.town);
    assert_eq!(notification(&only(&mut world.df)).unwrap(), items);
    world.df.agent_gone(known);
    assert_eq!(notification(&only(&mut world.df)).unwrap()[0].services, []);
}

#[test]
fn nobody_of_another_platform_speaks_for_one_of_ours() {
    let mut world = World::new();
    world.town = Town::new("robot1", "tcp://robot1:1").with("drive@robot1", "motor", true);
    let description = DfAgentDescription::of("drive@robot1");
    let request =
        || client::df_register_request(&DF.into(), &description).from_agent("drive@robot1");
    let answer = world.ask(Origin::Foreign, request());
    assert_eq!(
        client::done(&answer),
        Err(AnswerError::Refused(Reason::Unauthorised))
    );
    let answer = world.ask(Origin::Local, request());
    assert_eq!(client::done(&answer), Ok(()));
}

#[test]
fn what_is_stored_is_bounded() {
    let mut world = World::with(DfConfig {
        max_descriptions: 2,
        max_subscriptions: 1,
        ..DfConfig::new(DF, "u")
    });
    let of = |name: &str| format!("(df-agent-description :name (agent-identifier :name {name}))");
    world.register(&of("a")).unwrap();
    world.register(&of("b")).unwrap();
    assert!(matches!(
        world.register(&of("c")),
        Err(AnswerError::Failed(Reason::InternalError(_)))
    ));
    assert_eq!(world.register(&of("b")), failed(Reason::AlreadyRegistered));
    assert_eq!(world.df.len(), 2);
    let template = DfAgentDescription::of("nobody");
    world.subscribe(&template);
    assert_eq!(sent(&mut world.df), []);
    let second = client::df_subscribe_request(&DF.into(), &template, &SearchConstraints::all())
        .from_agent("other@robot2");
    let answer = world.ask(Origin::Foreign, second);
    assert_eq!(answer.performative, Performative::Refuse);
}

#[test]
fn a_search_goes_on_to_so_many_dfs_and_so_many_searches_wait() {
    let mut world = World::with(DfConfig {
        max_federated: 2,
        max_searches: 1,
        ..DfConfig::new(DF, "u")
    });
    for n in 2..6 {
        let service = "(service-description :name s :type FIPA-DF)";
        let description = format!(
            "(df-agent-description :name (agent-identifier :name df@robot{n}) :services (set {service}))"
        );
        world.register(&description).unwrap();
    }
    let constraints = SearchConstraints {
        max_depth: Some(1),
        ..SearchConstraints::all()
    };
    let template = DfAgentDescription::default();
    let mut messages_of_a_search = || {
        let request = client::df_search_request(&DF.into(), &template, &constraints);
        let request = request.from_agent("x@y");
        world
            .df
            .handle(world.now, Origin::Foreign, &request, &world.town);
        let messages = sent(&mut world.df).into_iter();
        messages
            .map(|message| message.performative)
            .collect::<Vec<_>>()
    };
    assert_eq!(
        messages_of_a_search(),
        [Performative::Request, Performative::Request]
    );
    // While that one waits, others are answered from here.
    assert_eq!(messages_of_a_search(), [Performative::Inform]);
}

#[test]
fn answers_are_not_answered_and_nobody_is_answered_who_has_no_name() {
    let mut world = World::new();
    for act in [
        "inform",
        "failure",
        "refuse",
        "not-understood",
        "agree",
        "confirm",
        "inform-ref",
    ] {
        let message = Message::new(act).from_agent("a@robot2").content("((foo))");
        world
            .df
            .handle(world.now, Origin::Foreign, &message, &world.town);
    }
    let anonymous = Message::new(Performative::Request).content("((foo))");
    world
        .df
        .handle(world.now, Origin::Foreign, &anonymous, &world.town);
    assert_eq!(sent(&mut world.df), []);
}

#[test]
fn what_is_not_said_is_taken_to_be_agent_management_in_sl0() {
    let mut world = World::new();
    let request = Message::new(Performative::Request).from_agent("a@robot1");
    let content = format!("((action {DF} (search (df-agent-description) (search-constraints))))");
    let answer = world.ask(Origin::Local, request.content(content));
    assert_eq!(answer.language, Some("fipa-sl0".into()));
    assert_eq!(answer.ontology, Some("fipa-agent-management".into()));
    assert_eq!(search_result(&answer), Ok(vec![]));
}
