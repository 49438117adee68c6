use fipa_acl::{AgentId, Expression, UserDefined};
use serde_json::{Map, Value};

use crate::JsonError;
use crate::reader::Fields;
use crate::values::{self, text, user_defined_to_json};

/// An agent identifier as `{"name":…,"addresses":[…],"resolvers":[…],"user-defined":{…}}`.
pub fn agent_id_to_json(agent: &AgentId) -> Value {
    let mut json = Map::new();
    json.insert("name".into(), agent.name.as_str().into());
    if !agent.addresses.is_empty() {
        let addresses = agent.addresses.iter().map(|url| Value::from(url.as_str()));
        json.insert("addresses".into(), addresses.collect());
    }
    put_agents(&mut json, "resolvers", &agent.resolvers);
    put_parameters(&mut json, &agent.user_defined);
    json.into()
}

/// Reads the form of [`agent_id_to_json`].
///
/// # Errors
/// A [`JsonError`] that names the key that is missing, unknown or of another type.
pub fn agent_id_from_json(value: &Value) -> Result<AgentId, JsonError> {
    let fields = Fields::new(value, &["name", "addresses", "resolvers", "user-defined"])?;
    Ok(AgentId {
        name: fields.required("name", text)?,
        addresses: fields.list("addresses", text)?,
        resolvers: fields.list("resolvers", agent_id_from_json)?,
        user_defined: parameters(&fields)?,
    })
}

/// Sets `key` to these agents, unless there are none.
pub(crate) fn put_agents(json: &mut Map<String, Value>, key: &str, agents: &[AgentId]) {
    if !agents.is_empty() {
        json.insert(key.into(), agents.iter().map(agent_id_to_json).collect());
    }
}

/// Sets `user-defined` to these parameters, unless there are none.
pub(crate) fn put_parameters(json: &mut Map<String, Value>, parameters: &[UserDefined]) {
    if !parameters.is_empty() {
        let shown = user_defined_to_json(parameters.iter().map(|p| (&p.name, &p.value)));
        json.insert("user-defined".into(), shown.into());
    }
}

/// The parameters under `user-defined`, whose values are expressions.
pub(crate) fn parameters(fields: &Fields<'_>) -> Result<Vec<UserDefined>, JsonError> {
    let given = fields.optional("user-defined", values::user_defined)?;
    Ok(given
        .into_iter()
        .flatten()
        .map(|(name, value)| UserDefined::new(name, Expression::from(value)))
        .collect())
}
