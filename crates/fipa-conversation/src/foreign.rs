//! Messages of other protocols: conversations within a conversation.

use std::sync::Arc;

use fipa_acl::Text;
use fipa_protocol::{Pattern, canonical_name};

use crate::branch::{Branch, Phase};
use crate::machine::{Context, Machine, Said};
use crate::plan::{Go, MAX_BRANCHES, NoPlan, Place, Plan, Step, Wrong, is_name_of, opening};
use crate::verdict::Rule;

impl Machine {
    /// A message of another protocol: of a sub-conversation that runs, or the first of one.
    pub(crate) fn plan_foreign<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
    ) -> Result<Plan<'a>, NoPlan> {
        let bears = said
            .message
            .protocol
            .as_ref()
            .map_or("", |name| name.as_str());
        let plan = |at, go| Plan {
            steps: vec![Step {
                place: Place::Branch(at),
                receivers: &said.message.receiver,
                go,
            }],
        };
        let mut wrong: Option<Wrong> = None;
        for (at, branch) in self.branches.iter().enumerate() {
            for (number, sub) in branch.subs.iter().enumerate() {
                if !is_name_of(sub.machine.protocol(), bears) {
                    continue;
                }
                match sub.machine.plan(
                    context,
                    Said {
                        foreign: false,
                        ..said
                    },
                ) {
                    Ok(inner) => return Ok(plan(at, Go::Sub(number, Box::new(inner)))),
                    Err(NoPlan::Wrong(inner)) => {
                        let nearest = Wrong {
                            sub: Some((number, Box::new(inner))),
                            ..Wrong::rule(Rule::SubProtocol).at(at)
                        };
                        wrong = wrong.or(Some(nearest));
                    }
                    Err(NoPlan::Unknown) => {}
                }
            }
        }
        let mut unknown = false;
        for (at, branch) in self.branches.iter().enumerate() {
            match self.open_sub(context, said, branch, bears) {
                Ok(go) => return Ok(plan(at, go)),
                Err(NoPlan::Unknown) => unknown = true,
                Err(NoPlan::Wrong(inner)) => {
                    if inner.too_many {
                        wrong = Some(inner.at(at));
                    } else if inner.rule == Rule::SubProtocol {
                        wrong = wrong.or(Some(inner.at(at)));
                    }
                }
            }
        }
        for (at, branch) in self.branches.iter().enumerate() {
            if let Ok(go) = self.try_branch(context, said, branch, &said.message.receiver) {
                return Ok(plan(at, go));
            }
        }
        match unknown {
            true => Err(NoPlan::Unknown),
            false => Err(wrong
                .unwrap_or_else(|| Wrong::rule(Rule::Protocol).at(0))
                .into()),
        }
    }

    fn open_sub<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        branch: &Branch,
        bears: &str,
    ) -> Result<Go<'a>, NoPlan> {
        let view = branch.view(&self.protocol, context.now);
        if *view.phase != Phase::Running {
            return Err(Wrong::rule(Rule::Protocol).into());
        }
        let known = context.library.get(bears);
        let canonical = canonical_name(bears);
        let is_named = |name: &Pattern| {
            let names = known.map_or(&[][..], |protocol| protocol.aliases());
            let own = known.map(|protocol| protocol.name());
            let mut names = names
                .iter()
                .chain(own)
                .map(Text::as_str)
                .chain([bears, canonical.as_str()]);
            names.any(|one| name.matches(one))
        };
        let mut named = view
            .state
            .subprotocols()
            .iter()
            .filter(|sub| is_named(sub.name()))
            .peekable();
        if named.peek().is_none() {
            return Err(Wrong::rule(Rule::Protocol).into());
        }
        let Some(sub) = named.find(|sub| self.plays(context, branch, sub.from(), said.sender))
        else {
            return Err(Wrong::rule(Rule::SubProtocol).into());
        };
        let protocol = known.ok_or(NoPlan::Unknown)?;
        let Some(transition) = opening(protocol, said.act()) else {
            return Err(Wrong::rule(Rule::SubProtocol).into());
        };
        if branch.subs.len() >= self.announced.unwrap_or(MAX_BRANCHES) {
            let wrong = Wrong::rule(Rule::SubProtocol);
            return Err(Wrong {
                too_many: true,
                ..wrong
            }
            .into());
        }
        Ok(Go::OpenSub {
            protocol: Arc::clone(protocol),
            transition,
            awaited: sub.is_awaited(),
        })
    }
}
