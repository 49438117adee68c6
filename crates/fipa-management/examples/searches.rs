//! How long searches take at a DF that holds many descriptions.
//!
//! ```sh
//! cargo run --release -p fipa-management --example searches
//! ```

use std::ops::ControlFlow;
use std::time::Instant;

use fipa_acl::{AgentId, Message, Text};
use fipa_directory::Now;
use fipa_management::client::{self, search_result};
use fipa_management::{
    ApService, Df, DfAgentDescription, DfConfig, DfOutput, DirectoryChange, DirectoryView,
    KnownAgent, Origin, Reason, SearchConstraints, ServiceDescription,
};

const DESCRIPTIONS: usize = 10_000;
const SEARCHES: usize = 100;
const TYPES: usize = 1000;
const ROUNDS: usize = 5;

fn main() {
    let mut df = Df::new(DfConfig::new("df@robot1", "bench"));
    let agent = AgentId::new("df@robot1");
    let started = Instant::now();
    for n in 0..DESCRIPTIONS {
        let description = description(n);
        let sender = description.name.clone().expect("it has one");
        ask(
            &mut df,
            &Agents(Vec::new()),
            &client::df_register_request(&agent, &description).from_agent(sender),
        );
    }
    let each = started.elapsed() / DESCRIPTIONS as u32;
    println!("{DESCRIPTIONS} descriptions registered, {each:?} each");

    let of_type = |n: usize| {
        DfAgentDescription::default().service(ServiceDescription::of_type(type_of(n * 7)))
    };
    let of_property = |n: usize| {
        let service =
            ServiceDescription::default().property("floor", format!("floor {n}").as_str());
        DfAgentDescription::default().service(service)
    };
    let of_both = |n: usize| DfAgentDescription {
        ontologies: vec![Text::from_static("factory")],
        ..of_type(n)
    };
    let of_nothing = |_| DfAgentDescription::default();
    let nobody = Agents(Vec::new());
    report(&mut df, &nobody, "by service type", of_type);
    report(&mut df, &nobody, "by type and ontology", of_both);
    report(
        &mut df,
        &nobody,
        "by a property, which no index has",
        of_property,
    );
    report(
        &mut df,
        &nobody,
        "by nothing, up to the 1000 that are given",
        of_nothing,
    );
    let agents = Agents(
        (0..DESCRIPTIONS)
            .map(|n| format!("known{n}@robot{}", n % 100))
            .collect(),
    );
    report(
        &mut df,
        &agents,
        "by service type, with as many agents in the directory",
        of_type,
    );
}

/// Times searches that wait all at once, from message to message.
fn report(
    df: &mut Df,
    directory: &Agents,
    what: &str,
    template: impl Fn(usize) -> DfAgentDescription,
) {
    let agent = AgentId::new("df@robot1");
    let requests: Vec<Message> = (0..SEARCHES)
        .map(|n| {
            client::df_search_request(&agent, &template(n), &SearchConstraints::all())
                .from_agent("fipa-1@robot2")
        })
        .collect();
    let mut times = Vec::new();
    let mut found = 0;
    for _ in 0..ROUNDS {
        let started = Instant::now();
        let answers: Vec<Message> = requests
            .iter()
            .map(|request| ask(df, directory, request))
            .collect();
        times.push(started.elapsed());
        let results = answers
            .iter()
            .map(|answer| search_result(answer).expect("a result"));
        found = results.map(|result| result.len()).sum();
    }
    times.sort();
    let median = times[ROUNDS / 2];
    println!("{SEARCHES} searches {what}: {median:?}, {found} descriptions found");
}

fn ask(df: &mut Df, directory: &Agents, message: &Message) -> Message {
    df.handle(Now::default(), Origin::Foreign, message, directory);
    match df.poll_output() {
        Some(DfOutput::Send(answer)) => *answer,
        other => panic!("{other:?} instead of an answer"),
    }
}

fn description(n: usize) -> DfAgentDescription {
    let service = ServiceDescription {
        ontologies: vec![Text::from_static("factory")],
        ..ServiceDescription::new(format!("service-{n}"), type_of(n))
    };
    let service = service.property("floor", format!("floor {}", n % 50).as_str());
    DfAgentDescription {
        ontologies: vec![Text::from_static("factory")],
        protocols: vec![Text::from_static("fipa-request")],
        languages: vec![Text::from_static("fipa-sl0")],
        ..DfAgentDescription::of(
            AgentId::new(format!("agent{n}@robot{}", n % 100)).address("tcp://192.168.0.1:4100"),
        )
    }
    .service(service)
}

fn type_of(n: usize) -> String {
    format!("type-{}", n % TYPES)
}

/// A directory of agents that have registered nowhere.
struct Agents(Vec<String>);

impl DirectoryView for Agents {
    fn platform(&self) -> Text {
        Text::from_static("robot1")
    }

    fn services(&self) -> Vec<ApService> {
        Vec::new()
    }

    fn find(&self, _: &str) -> Option<KnownAgent<'_>> {
        None
    }

    fn visit(&self, visitor: &mut dyn FnMut(KnownAgent<'_>) -> ControlFlow<()>) {
        let _ = self.0.iter().try_for_each(|name| {
            visitor(KnownAgent {
                name,
                kind: "agent",
                local: false,
            })
        });
    }

    fn addresses(&self, _: &str) -> Vec<Text> {
        Vec::new()
    }

    fn change(&mut self, _: DirectoryChange) -> Result<(), Reason> {
        Err(Reason::Unauthorised)
    }
}
