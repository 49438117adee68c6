/// What names of one protocol have in common: `fipa-contract-net`, `contractNet` and
/// `contract_net` are all `contractnet`.
///
/// Peers leave the prefix of the standard out, and write in camel case; messages keep the name that
/// they came with.
pub fn canonical_name(name: &str) -> String {
    let plain: String = name
        .chars()
        .filter(|c| !matches!(c, '-' | '_' | ' '))
        .map(|c| c.to_ascii_lowercase())
        .collect();
    match plain.strip_prefix("fipa") {
        Some(rest) if !rest.is_empty() => rest.to_owned(),
        _ => plain,
    }
}
