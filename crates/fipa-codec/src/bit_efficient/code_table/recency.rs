/// Numbers in the order of their last use: a doubly linked list in vectors, so that everything
/// takes the same short time however many there are.
#[derive(Debug, Default)]
pub(super) struct Recency {
    /// For each number its neighbours, if it is in the list.
    links: Vec<Link>,
    oldest: Option<u16>,
    newest: Option<u16>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Link {
    older: Option<u16>,
    newer: Option<u16>,
}

impl Recency {
    /// Puts a number in that is not in the list, as the newest.
    pub(super) fn insert(&mut self, number: u16) {
        if self.links.len() <= usize::from(number) {
            self.links.resize(usize::from(number) + 1, Link::default());
        }
        let older = self.newest.replace(number);
        self.set(Some(number), |link| *link = Link { older, newer: None });
        self.set(older, |link| link.newer = Some(number));
        self.oldest.get_or_insert(number);
    }

    /// Makes a number that is in the list the newest.
    pub(super) fn touch(&mut self, number: u16) {
        if self.newest != Some(number) {
            self.remove(number);
            self.insert(number);
        }
    }

    /// Takes out the number whose last use is the longest ago.
    pub(super) fn remove_oldest(&mut self) -> Option<u16> {
        let oldest = self.oldest?;
        self.remove(oldest);
        Some(oldest)
    }

    fn remove(&mut self, number: u16) {
        let Some(Link { older, newer }) = self.links.get(usize::from(number)).copied() else {
            return;
        };
        match older {
            Some(_) => self.set(older, |link| link.newer = newer),
            None => self.oldest = newer,
        }
        match newer {
            Some(_) => self.set(newer, |link| link.older = older),
            None => self.newest = older,
        }
    }

    fn set(&mut self, number: Option<u16>, change: impl FnOnce(&mut Link)) {
        if let Some(link) = number.and_then(|number| self.links.get_mut(usize::from(number))) {
            change(link);
        }
    }
}
