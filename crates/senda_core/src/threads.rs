//! Two things at once, where neither sees the other: the result does not depend on whether they really were.

/// Less work than this (in texels, pixels or the like) is not worth a thread.
const WORTH: usize = 100_000;

/// Does both, at the same time if there is at least `amount` of work for it to be worth a thread, else one after the
/// other.
///
/// ```
/// let mut numbers = [1, 2, 3, 4];
/// let (left, right) = numbers.split_at_mut(2);
/// senda_core::threads::both(1_000_000, || left.reverse(), || right.fill(0));
/// assert_eq!(numbers, [2, 1, 0, 0]);
/// ```
pub fn both(amount: usize, first: impl FnOnce(), second: impl FnOnce() + Send) {
    if amount < WORTH {
        first();
        second();
        return;
    }
    // Taken by whoever comes first: where no thread can be had, that is this one.
    let second = std::sync::Mutex::new(Some(second));
    let run = || {
        let taken = second.lock().ok().and_then(|mut second| second.take());
        if let Some(second) = taken {
            second();
        }
    };
    std::thread::scope(|scope| {
        let helper = std::thread::Builder::new()
            .name("half".into())
            .spawn_scoped(scope, run);
        first();
        if helper.is_err() {
            run();
        }
    });
}
