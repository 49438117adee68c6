//! Platforms of other makes whose agents are listed here: their AMS is asked, again and again.

use std::time::Duration;

use fipa_acl::{AgentId, Text};
use fipa_directory::{Address, Entry};
use fipa_management::{AmsAgentDescription, ApDescription, SearchConstraints, client};

use super::host::Desk;
use super::view::entry;

/// How long an answer is waited for.
const PATIENCE: Duration = Duration::from_secs(5);

/// How often a platform is asked for its agents.
const REFRESH: Duration = Duration::from_secs(10);

/// The pause before a platform is asked again that did not answer.
const RETRY: Duration = Duration::from_secs(2);

/// Questions without an answer after which a platform is gone.
const MISSES: u32 = 3;

/// Lists the agents of a platform at the request of somebody, who is told its name; from then on
/// it is looked after.
pub(super) async fn add(desk: Desk, url: Text, told: impl FnOnce(Result<Text, String>)) {
    let address = match url.parse() {
        Ok(address @ Address::Http { .. }) => address,
        _ => return told(Err(format!("{url} is no URL of a platform"))),
    };
    let name = url.split_once('#').map(|(_, name)| Text::from(name));
    let found = look(&desk, &address, name).await;
    let name = found.as_ref().ok().cloned();
    told(found);
    if name.is_some() {
        tokio::time::sleep(REFRESH).await;
        follow(desk, address, name).await;
    }
}

/// Keeps what the directory holds of a platform as its AMS tells, as long as the service is there.
pub(super) async fn follow(desk: Desk, url: Address, mut name: Option<Text>) {
    let mut misses = 0;
    while desk.is_open() {
        match look(&desk, &url, name.clone()).await {
            Ok(platform) => {
                name = Some(platform);
                misses = 0;
                tokio::time::sleep(REFRESH).await;
            }
            Err(reason) => {
                misses += 1;
                tracing::debug!("the platform at {url}: {reason}");
                if misses == MISSES
                    && let Some(platform) = &name
                {
                    tracing::warn!("the platform {platform} at {url} is gone: {reason}");
                    update(&desk, platform, &[]);
                }
                tokio::time::sleep(RETRY).await;
            }
        }
    }
}

/// Asks a platform who is there. Its name.
async fn look(desk: &Desk, url: &Address, name: Option<Text>) -> Result<Text, String> {
    let name = match name {
        Some(name) => name,
        None => name_at(desk, url).await?,
    };
    let ams = AgentId::new(format!("ams@{name}")).address(url.to_text());
    let answer = desk
        .ask(client::ams_description_request(&ams), PATIENCE)
        .await?;
    let described = client::description_result(&answer).map_err(|error| error.to_string())?;
    let described = reached_at(described, url);
    let all = AmsAgentDescription::default();
    let search = client::ams_search_request(&ams, &all, &SearchConstraints::all());
    let answer = desk.ask(search, PATIENCE).await?;
    let found = client::agents_result(&answer).map_err(|error| error.to_string())?;
    let agents = found
        .into_iter()
        .filter_map(|agent| agent.at(&described).name);
    let description = format!("Agent of {name}");
    let mut entries: Vec<Entry> = agents.map(|agent| entry(&agent, &description)).collect();
    let management = ["ams", "df"].map(|role| {
        let agent = AgentId::new(format!("{role}@{name}")).address(url.to_text());
        entry(&agent, &description)
    });
    entries.retain(|entry| management.iter().all(|one| one.name != entry.name));
    entries.extend(management);
    update(desk, &name, &entries);
    Ok(name)
}

/// The platform with the address under which it answered, if it tells none that can be used.
fn reached_at(mut described: ApDescription, url: &Address) -> ApDescription {
    for service in &mut described.services {
        let is_url = |at: &Text| at.parse().is_ok_and(|at: Address| at.is_http());
        service.addresses.retain(is_url);
    }
    if described
        .services
        .iter()
        .all(|service| service.addresses.is_empty())
    {
        described.services = super::services(vec![url.to_text()]);
    }
    described
}

/// The name of the platform at a URL. Whatever AMS answers there, be it that it does not know the
/// agent that was asked, says by its own name which platform it manages.
async fn name_at(desk: &Desk, url: &Address) -> Result<Text, String> {
    let nobody = AgentId::new("ams@unknown").address(url.to_text());
    let answer = desk
        .ask(client::ams_description_request(&nobody), PATIENCE)
        .await?;
    let sender = answer.sender.map(|sender| sender.name).unwrap_or_default();
    match sender.split_once('@') {
        Some((role, platform)) if role.eq_ignore_ascii_case("ams") => Ok(Text::from(platform)),
        _ => Err(format!("{sender} answered, which is no AMS")),
    }
}

/// Makes the entries all that is known of a platform.
fn update(desk: &Desk, platform: &Text, entries: &[Entry]) {
    desk.with(|now, mts, _| {
        for name in mts.listed_by(platform) {
            if entries.iter().all(|entry| entry.name != name) {
                mts.agent_unlisted(now, &name);
            }
        }
        for entry in entries {
            mts.agent_listed(now, platform, entry.clone());
        }
    });
}
