use fipa_acl::{AgentId, FipaTime, Text};
use fipa_sl::{FrameError, Functional, Term, agent_id};

/// An object of the ontology that is being read.
pub(super) struct Frame<'a> {
    object: &'static str,
    functional: &'a Functional,
}

impl<'a> Frame<'a> {
    pub(super) fn of(term: &'a Term, object: &'static str) -> Result<Frame<'a>, FrameError> {
        let functional = term.functional(object);
        let functional = functional.ok_or(FrameError::NotA { object })?;
        Ok(Frame { object, functional })
    }

    pub(super) fn text(&self, parameter: &'static str) -> Result<Option<Text>, FrameError> {
        self.read(parameter, text_of)
    }

    pub(super) fn required_text(&self, parameter: &'static str) -> Result<Text, FrameError> {
        let missing = FrameError::Missing {
            object: self.object,
            parameter,
        };
        self.text(parameter)?.ok_or(missing)
    }

    pub(super) fn texts(&self, parameter: &'static str) -> Result<Vec<Text>, FrameError> {
        let texts = self.read(parameter, |term| match term.items() {
            Some(items) => items.iter().map(text_of).collect(),
            None => text_of(term).map(|text| vec![text]),
        });
        Ok(texts?.unwrap_or_default())
    }

    pub(super) fn agent(&self, parameter: &'static str) -> Result<Option<AgentId>, FrameError> {
        let value = self.functional.parameter(parameter);
        value.map(agent_id).transpose()
    }

    pub(super) fn time(&self, parameter: &'static str) -> Result<Option<FipaTime>, FrameError> {
        self.read(parameter, Term::as_time)
    }

    pub(super) fn integer(&self, parameter: &'static str) -> Result<Option<i64>, FrameError> {
        self.read(parameter, Term::as_integer)
    }

    pub(super) fn value(&self, parameter: &'static str) -> Option<Term> {
        self.functional.parameter(parameter).cloned()
    }

    /// The objects in a set or a sequence, or one alone.
    pub(super) fn objects<T>(
        &self,
        parameter: &'static str,
        read: impl Fn(&Term) -> Result<T, FrameError>,
    ) -> Result<Vec<T>, FrameError> {
        match self.functional.parameter(parameter) {
            None => Ok(Vec::new()),
            Some(value) => match value.items() {
                Some(items) => items.iter().map(read).collect(),
                None => read(value).map(|object| vec![object]),
            },
        }
    }

    fn read<T>(
        &self,
        parameter: &'static str,
        read: impl Fn(&Term) -> Option<T>,
    ) -> Result<Option<T>, FrameError> {
        let Some(value) = self.functional.parameter(parameter) else {
            return Ok(None);
        };
        let wrong = || FrameError::Value {
            object: self.object,
            parameter,
            value: Text::from(value.to_string()),
        };
        read(value).map(Some).ok_or_else(wrong)
    }
}

/// Text, or what looks like something else and is written without quotes.
fn text_of(term: &Term) -> Option<Text> {
    match term {
        Term::Number(number) => Some(number.clone()),
        Term::Truth(_) | Term::Time(_) => Some(Text::from(term.to_string())),
        term => term.as_text(),
    }
}

/// Adding lists to an object that is being written.
pub(super) trait WithLists {
    fn with_set(self, parameter: &'static str, items: impl IntoIterator<Item = Term>) -> Self;
    fn with_sequence(self, parameter: &'static str, items: impl IntoIterator<Item = Term>) -> Self;
}

impl WithLists for Functional {
    fn with_set(self, parameter: &'static str, items: impl IntoIterator<Item = Term>) -> Self {
        with_list(self, parameter, "set", items)
    }

    fn with_sequence(self, parameter: &'static str, items: impl IntoIterator<Item = Term>) -> Self {
        with_list(self, parameter, "sequence", items)
    }
}

fn with_list(
    object: Functional,
    parameter: &'static str,
    symbol: &'static str,
    items: impl IntoIterator<Item = Term>,
) -> Functional {
    let list = Functional::new(Text::from_static(symbol), items);
    if list.positional().is_empty() {
        return object;
    }
    object.with(Text::from_static(parameter), list)
}
