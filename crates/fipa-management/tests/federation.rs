//! DFs that search for each other, on a simulated network and clock.

mod support;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_directory::Now;
use fipa_management::client::{self, search_result};
use fipa_management::{
    Df, DfAgentDescription, DfConfig, DfOutput, Origin, Reason, SearchConstraints,
    ServiceDescription,
};
use support::Town;

const CLIENT: &str = "fipa-1@robot0";

/// DFs, the letters between them, and the time.
struct Net {
    now: Now,
    dfs: BTreeMap<Text, (Df, Town)>,
    letters: VecDeque<Message>,
    /// DFs that get no letters.
    deaf: Vec<&'static str>,
    /// What reached the client.
    answers: Vec<Message>,
    federations: Vec<(Text, Result<(), Reason>)>,
    /// Letters delivered.
    delivered: usize,
}

impl Net {
    fn new(robots: usize) -> Net {
        let dfs = (1..=robots).map(|n| {
            let name = Text::from(format!("df@robot{n}"));
            let town = Town::new(&format!("robot{n}"), &format!("tcp://robot{n}:1"));
            (name.clone(), (Df::new(DfConfig::new(name, "u")), town))
        });
        Net {
            now: Now::default().plus(Duration::from_secs(1_000_000)),
            dfs: dfs.collect(),
            letters: VecDeque::new(),
            deaf: Vec::new(),
            answers: Vec::new(),
            federations: Vec::new(),
            delivered: 0,
        }
    }

    /// Makes the second DF search at the first as well.
    fn federate(&mut self, child: &str, parent: &str) {
        let request = client::df_federate_request(&child.into(), &parent.into());
        self.ask_own(child, request);
        assert_eq!(self.federations.pop(), Some((parent.into(), Ok(()))));
        let answer = self.answers.pop().unwrap();
        assert_eq!(client::done(&answer), Ok(()));
    }

    /// An agent of its own platform asks a DF.
    fn ask_own(&mut self, df: &str, request: Message) {
        let request = request.from_agent(CLIENT).reply_with("r");
        let (df, town) = self.dfs.get_mut(df).unwrap();
        df.handle(self.now, Origin::Local, &request, town);
        self.collect();
        self.run();
    }

    fn offer(&mut self, agent: &str, at: &str) {
        let description =
            DfAgentDescription::of(agent).service(ServiceDescription::new("s", "weather"));
        let request = client::df_register_request(&at.into(), &description).from_agent(agent);
        self.letters.push_back(request);
        self.run();
    }

    fn search(&mut self, at: &str, constraints: SearchConstraints) {
        let template =
            DfAgentDescription::default().service(ServiceDescription::of_type("weather"));
        let request = client::df_search_request(&at.into(), &template, &constraints)
            .from_agent(CLIENT)
            .reply_with("r");
        self.letters.push_back(request);
        self.run();
    }

    /// Delivers letters until none is left.
    fn run(&mut self) {
        while let Some(letter) = self.letters.pop_front() {
            self.delivered += 1;
            assert!(self.delivered < 10_000, "it does not end");
            let to = letter.receiver[0].name.clone();
            let Some((df, town)) = self.dfs.get_mut(&to) else {
                if to == CLIENT {
                    self.answers.push(letter);
                }
                continue;
            };
            if !self.deaf.contains(&&*to) {
                df.handle(self.now, Origin::Foreign, &letter, town);
                self.collect();
            }
        }
    }

    fn collect(&mut self) {
        for (df, _) in self.dfs.values_mut() {
            while let Some(output) = df.poll_output() {
                match output {
                    DfOutput::Send(message) => self.letters.push_back(*message),
                    DfOutput::Federation { parent, result } => {
                        self.federations.push((parent, result));
                    }
                }
            }
        }
    }

    /// Lets time pass until nobody waits.
    fn wait(&mut self) {
        while let Some(next) = self
            .dfs
            .values()
            .filter_map(|(df, _)| df.poll_timeout())
            .min()
        {
            let span = next.saturating_sub(self.now.mono);
            self.now = self.now.plus(span);
            for (df, _) in self.dfs.values_mut() {
                df.handle_timeout(self.now);
            }
            self.collect();
            self.run();
        }
    }

    /// The names that the only answer holds.
    fn found(&mut self) -> Vec<String> {
        let [answer] = <[Message; 1]>::try_from(std::mem::take(&mut self.answers)).unwrap();
        let found = search_result(&answer).unwrap();
        let mut names: Vec<_> = found
            .into_iter()
            .map(|d| d.name.unwrap().name.to_string())
            .collect();
        names.sort();
        names
    }
}

fn to_depth(depth: i64) -> SearchConstraints {
    SearchConstraints {
        max_depth: Some(depth),
        ..SearchConstraints::all()
    }
}

/// A ring in which each searches at the next, with an agent on every robot.
fn ring() -> Net {
    let mut net = Net::new(3);
    net.federate("df@robot2", "df@robot1");
    net.federate("df@robot3", "df@robot2");
    net.federate("df@robot1", "df@robot3");
    for n in 1..=3 {
        net.offer(&format!("a@robot{n}"), &format!("df@robot{n}"));
    }
    net.delivered = 0;
    net
}

#[test]
fn a_search_in_a_ring_ends_and_finds_everybody_once() {
    for depth in [-1, 2, 3, 100] {
        let mut net = ring();
        net.search("df@robot1", to_depth(depth));
        assert_eq!(net.found(), ["a@robot1", "a@robot2", "a@robot3"], "{depth}");
        assert!(net.delivered <= 8, "{} letters", net.delivered);
        assert_eq!(net.letters.len(), 0);
    }
}

#[test]
fn a_search_goes_as_deep_as_it_may() {
    for (depth, found) in [(0, 1), (1, 2), (2, 3)] {
        let mut net = ring();
        net.search("df@robot1", to_depth(depth));
        assert_eq!(net.found().len(), found, "{depth}");
    }
}

#[test]
fn everybody_linked_with_everybody_ends_and_finds_everybody_once() {
    let mut net = Net::new(5);
    for child in 1..=5 {
        net.offer(&format!("a@robot{child}"), &format!("df@robot{child}"));
        // The same agent at two DFs.
        net.offer("twice@robot0", &format!("df@robot{child}"));
        for parent in (1..=5).filter(|parent| *parent != child) {
            net.federate(&format!("df@robot{child}"), &format!("df@robot{parent}"));
        }
    }
    net.delivered = 0;
    net.search("df@robot1", to_depth(-1));
    assert_eq!(net.found().len(), 6);
    assert!(net.delivered < 60, "{} letters", net.delivered);
}

#[test]
fn no_more_is_searched_than_is_wanted() {
    let mut net = ring();
    let one = SearchConstraints {
        max_results: None,
        ..to_depth(-1)
    };
    net.search("df@robot1", one);
    assert_eq!(net.found(), ["a@robot1"]);
    assert_eq!(net.delivered, 2);
    let two = SearchConstraints {
        max_results: Some(2),
        ..to_depth(-1)
    };
    net.search("df@robot1", two);
    assert_eq!(net.found(), ["a@robot1", "a@robot2"]);
}

#[test]
fn who_gets_fewer_than_others_know_is_told() {
    let mut net = Net::new(2);
    let config = DfConfig {
        max_foreign_results: 2,
        ..DfConfig::new("df@robot2", "u")
    };
    net.dfs.get_mut("df@robot2").unwrap().0 = Df::new(config);
    net.federate("df@robot2", "df@robot1");
    for agent in ["a@robot2", "b@robot2", "c@robot2"] {
        net.offer(agent, "df@robot2");
    }
    for (wanted, given, more) in [(2, 2, false), (3, 2, true), (-1, 2, true)] {
        let constraints = SearchConstraints {
            max_results: Some(wanted),
            ..to_depth(1)
        };
        net.search("df@robot1", constraints);
        assert_eq!(client::has_more(net.answers.last().unwrap()), more);
        assert_eq!(net.found().len(), given);
    }
}

#[test]
fn a_df_that_is_silent_holds_nobody_up_for_long() {
    let mut net = Net::new(4);
    net.federate("df@robot2", "df@robot1");
    net.federate("df@robot3", "df@robot1");
    net.federate("df@robot4", "df@robot3");
    for n in 1..=4 {
        net.offer(&format!("a@robot{n}"), &format!("df@robot{n}"));
    }
    net.deaf = vec!["df@robot2", "df@robot4"];
    let start = net.now.mono;
    net.search("df@robot1", to_depth(5));
    assert_eq!(net.answers.len(), 0);
    net.wait();
    // The one in between gives up in time for its own results to count.
    assert_eq!(net.found(), ["a@robot1", "a@robot3"]);
    assert_eq!(net.now.mono - start, Duration::from_secs(10));
}

#[test]
fn who_waits_for_a_short_time_is_answered_within_it() {
    let mut net = ring();
    net.deaf = vec!["df@robot2"];
    let template = DfAgentDescription::default();
    let request = client::df_search_request(&"df@robot1".into(), &template, &to_depth(1))
        .from_agent(CLIENT)
        .reply_by(fipa_acl::FipaTime::from_unix_millis(
            net.now.unix_millis + 4000,
        ));
    net.letters.push_back(request);
    net.run();
    let start = net.now.mono;
    net.wait();
    assert_eq!(net.answers.len(), 1);
    assert_eq!(net.now.mono - start, Duration::from_secs(3));
}

/// The search that the DF of robot 1 hands on to that of robot 2.
fn handed_on(net: &mut Net) -> Message {
    net.deaf = vec!["df@robot2"];
    let (df, town) = net.dfs.get_mut("df@robot1").unwrap();
    let template = DfAgentDescription::default().service(ServiceDescription::of_type("weather"));
    let request = client::df_search_request(&"df@robot1".into(), &template, &to_depth(1));
    df.handle(net.now, Origin::Foreign, &request.from_agent(CLIENT), town);
    let Some(DfOutput::Send(question)) = df.poll_output() else {
        panic!("nobody was asked");
    };
    *question
}

#[test]
fn a_df_that_cannot_be_reached_is_not_waited_for() {
    let mut net = ring();
    let question = handed_on(&mut net);
    let failure = question
        .reply(Performative::Failure)
        .from_agent("mts@robot1");
    net.letters.push_back(
        failure
            .to("df@robot1")
            .content("((action x (y)) (MTS-error z w))"),
    );
    net.run();
    assert_eq!(net.found(), ["a@robot1"]);
}

#[test]
fn results_are_taken_from_the_one_who_was_asked_only() {
    let mut net = ring();
    let question = handed_on(&mut net);
    let content = "((result (action df@robot2 (search)) \
        (sequence (df-agent-description :name (agent-identifier :name evil@x)))))";
    assert!(search_result(&Message::new(Performative::Inform).content(content)).is_ok());
    let forged = question
        .reply(Performative::Inform)
        .from_agent("evil@x")
        .content(content);
    let mut agree = question.reply(Performative::Agree).from_agent("df@robot2");
    agree.content = None;
    net.letters.extend([forged, agree]);
    net.run();
    assert_eq!(net.answers.len(), 0);
    net.wait();
    assert_eq!(net.found(), ["a@robot1"]);
}

#[test]
fn a_child_registers_leaves_and_is_told_how_it_went() {
    let mut net = Net::new(2);
    let parent = AgentId::new("df@robot1");
    net.federate("df@robot2", "df@robot1");
    // To be there already is as good.
    net.federate("df@robot2", "df@robot1");
    assert_eq!(net.dfs["df@robot1"].0.len(), 1);
    let leave = |net: &mut Net| {
        let request = client::df_leave_request(&"df@robot2".into(), &parent);
        net.ask_own("df@robot2", request);
    };
    leave(&mut net);
    assert_eq!(net.federations.pop(), Some((parent.name.clone(), Ok(()))));
    assert!(net.dfs["df@robot1"].0.is_empty());
    leave(&mut net);
    assert_eq!(
        net.federations.pop(),
        Some((parent.name.clone(), Err(Reason::NotRegistered)))
    );
    let told = net.answers.pop().unwrap();
    let reason = client::AnswerError::Failed(Reason::NotRegistered);
    assert_eq!(client::done(&told), Err(reason));
    net.deaf = vec!["df@robot1"];
    leave(&mut net);
    net.wait();
    let (_, result) = net.federations.pop().unwrap();
    assert_eq!(result.unwrap_err().to_string(), "it did not answer in time");
}

#[test]
fn nobody_of_another_platform_has_a_df_federate() {
    let mut net = Net::new(2);
    let parent = AgentId::new("df@robot1");
    let request = client::df_federate_request(&"df@robot2".into(), &parent);
    net.letters.push_back(request.from_agent(CLIENT));
    net.run();
    let told = net.answers.pop().unwrap();
    assert_eq!(told.performative, Performative::NotUnderstood);
    assert!(net.federations.is_empty() && net.dfs["df@robot1"].0.is_empty());
}

#[test]
fn a_request_to_federate_names_the_other_df() {
    let mut net = Net::new(1);
    let request = client::df_federate_request(&"df@robot1".into(), &"df@robot2".into());
    let content = request.content_str().unwrap().to_owned();
    assert_eq!(
        content,
        "((action (agent-identifier :name df@robot1) \
         (federate :df (agent-identifier :name df@robot2))))"
    );
    let without = request.content(content.replace(":df (agent-identifier :name df@robot2)", ""));
    net.ask_own("df@robot1", without);
    let told = net.answers.pop().unwrap();
    assert_eq!(told.performative, Performative::Refuse);
}
