use fipa_acl::Text;

use crate::pattern::Pattern;
use crate::protocol::{Party, Role, RoleId, Rules, SELF};

/// The roles met so far.
pub(super) struct Roles {
    pub(super) found: Vec<Role>,
    pub(super) rules: Rules,
    pub(super) max_pattern: usize,
}

impl Roles {
    pub(super) fn party(&mut self, name: &str) -> Result<Party, String> {
        if name == SELF {
            return Ok(Party::Own);
        }
        if let Some(at) = self.found.iter().position(|role| role.name == name) {
            return Ok(Party::Role(RoleId(at as u16)));
        }
        let id =
            u16::try_from(self.found.len()).map_err(|_| "there are too many roles".to_owned())?;
        // To fipa_acl each name is an expression as well.
        let pattern = match self.rules == Rules::FipaAcl || Pattern::is_meant(name) {
            true => Some(Pattern::new(name, self.max_pattern).map_err(|error| error.to_string())?),
            false => None,
        };
        self.found.push(Role {
            name: Text::from(name),
            open: false,
            pattern,
        });
        Ok(Party::Role(RoleId(id)))
    }

    pub(super) fn declare(&mut self, name: &str, open: bool) {
        if let Ok(Party::Role(id)) = self.party(name)
            && let Some(role) = self.found.get_mut(usize::from(id.0))
        {
            role.open = open;
        }
    }
}
