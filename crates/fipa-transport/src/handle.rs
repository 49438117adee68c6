use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// Wakes a connection that waits for its partner.
#[derive(Debug, Default)]
pub struct Handle(Mutex<Asked>);

/// What a connection is asked for, and how it is woken.
#[derive(Debug, Default)]
struct Asked {
    transmit: bool,
    wish: Wish,
    waker: Option<Waker>,
}

/// How a connection is wished to end; a stronger wish replaces a weaker one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Wish {
    /// Not yet.
    #[default]
    None,
    /// When all is written, however long that takes.
    Finish,
    /// When all is written, or the partner takes nothing any more.
    Close,
    /// Now.
    Abort,
}

impl Handle {
    /// There is something to write.
    pub fn transmit(&self) {
        self.ask(Wish::None);
    }

    /// The connection closes as soon as all that waits is written, or the partner takes no more.
    pub fn close(&self) {
        self.ask(Wish::Close);
    }

    /// The connection closes as soon as all that waits is written, however long the partner takes
    /// for it.
    pub fn finish(&self) {
        self.ask(Wish::Finish);
    }

    /// The connection is broken off at once: the partner sees an error, not an end.
    pub fn abort(&self) {
        self.ask(Wish::Abort);
    }

    fn ask(&self, wish: Wish) {
        let mut asked = self.lock();
        asked.wish = asked.wish.max(wish);
        asked.transmit = true;
        let waker = asked.waker.take();
        drop(asked);
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// How the connection is wished to end.
    pub(crate) fn wish(&self) -> Wish {
        self.lock().wish
    }

    /// Whether something was asked that is not done yet.
    pub(crate) fn is_asked(&self) -> bool {
        self.lock().transmit
    }

    /// Ready once for all that was asked since the last time.
    pub(crate) fn poll_asked(&self, cx: &mut Context<'_>) -> Poll<()> {
        let mut asked = self.lock();
        if std::mem::take(&mut asked.transmit) {
            return Poll::Ready(());
        }
        match &asked.waker {
            Some(waker) if waker.will_wake(cx.waker()) => {}
            _ => asked.waker = Some(cx.waker().clone()),
        }
        Poll::Pending
    }

    fn lock(&self) -> MutexGuard<'_, Asked> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
