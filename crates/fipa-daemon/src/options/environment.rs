//! The environment variables `FIPAD_NAME`, `FIPAD_LISTEN` and so on.

use std::path::PathBuf;

use super::{Layer, OptionsError, value};

/// The variable that names the configuration file.
pub(super) fn config(env: impl Fn(&str) -> Option<String>) -> Option<PathBuf> {
    said(&env, "FIPAD_CONFIG").map(PathBuf::from)
}

/// What the variables say.
pub(super) fn layer(env: impl Fn(&str) -> Option<String>) -> Result<Layer, OptionsError> {
    let env = &env;
    Ok(Layer {
        name: one(env, "FIPAD_NAME", value::name)?,
        listen: list(env, "FIPAD_LISTEN", value::listen_address)?,
        http: one(env, "FIPAD_HTTP", value::http_endpoint)?,
        http_path: one(env, "FIPAD_HTTP_PATH", value::http_path)?,
        advertise: list(env, "FIPAD_ADVERTISE", value::peer_address)?,
        scope: one(env, "FIPAD_SCOPE", value::scope)?,
        fleet: said(env, "FIPAD_FLEET").map(PathBuf::from),
        fleet_mode: one(env, "FIPAD_FLEET_MODE", value::fleet_mode)?,
        pinned: list(env, "FIPAD_PINNED", value::fingerprint)?,
        require_fleet: one(env, "FIPAD_REQUIRE_FLEET", value::flag)?,
        rules: None,
        interface: list(env, "FIPAD_INTERFACE", value::interface)?,
        no_mdns: one(env, "FIPAD_NO_MDNS", value::flag)?,
        mdns_agents: one(env, "FIPAD_MDNS_AGENTS", value::count_text)?,
        mdns_port: one(env, "FIPAD_MDNS_PORT", value::port_text)?,
        peer: list(env, "FIPAD_PEER", value::peer_address)?,
        control: said(env, "FIPAD_CONTROL").map(PathBuf::from),
        json: one(env, "FIPAD_JSON", value::flag)?,
        owns: list(env, "FIPAD_OWNS", value::resource)?,
        hiac: list(env, "FIPAD_HIAC", value::hiac_endpoint)?,
        hiac_address: one(env, "FIPAD_HIAC_ADDRESS", value::hiac_workgroup)?,
        hiac_names: None,
        text: list(env, "FIPAD_TEXT", value::text_endpoint)?,
        text_agents: None,
        log_letters: said(env, "FIPAD_LOG_LETTERS").map(PathBuf::from),
        max_letter: one(env, "FIPAD_MAX_LETTER", value::letter_size_text)?,
        state: said(env, "FIPAD_STATE").map(PathBuf::from),
        outbox: None,
    })
}

fn one<T>(
    env: &impl Fn(&str) -> Option<String>,
    name: &'static str,
    read: impl Fn(&str) -> Result<T, String>,
) -> Result<Option<T>, OptionsError> {
    let value = said(env, name).map(|value| read(&value)).transpose();
    value.map_err(|problem| OptionsError::Variable { name, problem })
}

/// Values between commas and white space. A variable of nothing else says nothing.
fn list<T>(
    env: &impl Fn(&str) -> Option<String>,
    name: &'static str,
    read: impl Fn(&str) -> Result<T, String>,
) -> Result<Option<Vec<T>>, OptionsError> {
    let text = said(env, name).unwrap_or_default();
    let parts = text.split(|c: char| c == ',' || c.is_whitespace());
    let values = parts.filter(|part| !part.is_empty()).map(read);
    match values.collect::<Result<Vec<T>, String>>() {
        Ok(values) if values.is_empty() => Ok(None),
        Ok(values) => Ok(Some(values)),
        Err(problem) => Err(OptionsError::Variable { name, problem }),
    }
}

/// The value of a variable. Empty is as good as not set, since unit files and scripts cannot
/// always leave a variable out.
fn said(env: &impl Fn(&str) -> Option<String>, name: &str) -> Option<String> {
    env(name).filter(|value| !value.is_empty())
}
