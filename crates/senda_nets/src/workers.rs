//! A few named threads that share out numbered tasks. Who does which task is left to chance; results must not depend
//! on it.
#![allow(unsafe_code)]

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// A job as the threads see it: called with the number of the thread and of the task.
type Job = &'static (dyn Fn(usize, usize) + Sync);

#[derive(Default)]
struct Board {
    job: Option<Job>,
    /// Next task to hand out, and how many there are.
    next: usize,
    count: usize,
    /// Tasks that are being worked on.
    running: usize,
    has_failed: bool,
    is_closed: bool,
}

#[derive(Default)]
struct Shared {
    board: Mutex<Board>,
    has_work: Condvar,
    is_done: Condvar,
}

impl Shared {
    fn board(&self) -> MutexGuard<'_, Board> {
        // A task that panicked is remembered on the board; the lock itself is never held meanwhile.
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Works on tasks until none is left to start.
    fn work(&self, worker: usize) {
        let mut board = self.board();
        while let Some(job) = board.job.filter(|_| board.next < board.count) {
            let task = board.next;
            board.next += 1;
            board.running += 1;
            drop(board);
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| job(worker, task)));
            board = self.board();
            board.running -= 1;
            board.has_failed |= outcome.is_err();
        }
        if board.next >= board.count && board.running == 0 {
            board.job = None;
            self.is_done.notify_all();
        }
    }
}

/// The threads. The one that calls [`Workers::run`] is number 0 and works too.
pub(crate) struct Workers {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    pub(crate) fn new(count: usize) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let mut threads = Vec::new();
        for worker in 1..count.max(1) {
            let shared = Arc::clone(&shared);
            threads.push(
                std::thread::Builder::new()
                    .name(format!("train-{worker}"))
                    .spawn(move || {
                        loop {
                            let mut board = shared.board();
                            while !board.is_closed && (board.job.is_none() || board.next >= board.count) {
                                board = shared
                                    .has_work
                                    .wait(board)
                                    .unwrap_or_else(PoisonError::into_inner);
                            }
                            if board.is_closed {
                                return;
                            }
                            drop(board);
                            shared.work(worker);
                        }
                    })?,
            );
        }
        Ok(Self { shared, threads })
    }

    pub(crate) fn count(&self) -> usize {
        self.threads.len() + 1
    }

    /// Calls `job(worker, task)` for every task below `count`, and returns when all are done.
    pub(crate) fn run(&mut self, count: usize, job: &(dyn Fn(usize, usize) + Sync)) {
        if count == 1 || self.threads.is_empty() {
            (0..count).for_each(|task| job(0, task));
            return;
        }
        // SAFETY: the board forgets the job before this function returns, and no thread calls it afterwards: the loop
        // below waits until no task is left or running.
        let job = unsafe { std::mem::transmute::<&(dyn Fn(usize, usize) + Sync), Job>(job) };
        {
            let mut board = self.shared.board();
            board.job = Some(job);
            (board.next, board.count) = (0, count);
        }
        self.shared.has_work.notify_all();
        self.shared.work(0);
        let mut board = self.shared.board();
        while board.next < board.count || board.running > 0 {
            board = self
                .shared
                .is_done
                .wait(board)
                .unwrap_or_else(PoisonError::into_inner);
        }
        board.job = None;
        let has_failed = std::mem::take(&mut board.has_failed);
        drop(board);
        assert!(!has_failed, "a task of the training threads panicked");
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.shared.board().is_closed = true;
        self.shared.has_work.notify_all();
        for thread in self.threads.drain(..) {
            // A thread that panicked has been reported by `run`.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn every_task_is_done_once() {
        for threads in [1, 2, 3, 8] {
            let mut workers = Workers::new(threads).unwrap();
            for count in [0, 1, 2, 7, 100] {
                let done: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
                workers.run(count, &|worker, task| {
                    assert!(worker < threads);
                    done[task].fetch_add(1, Ordering::Relaxed);
                });
                assert!(done.iter().all(|done| done.load(Ordering::Relaxed) == 1));
            }
        }
    }

    #[test]
    #[should_panic(expected = "panicked")]
    fn a_panic_in_a_task_is_not_lost() {
        let mut workers = Workers::new(2).unwrap();
        workers.run(5, &|_, task| assert!(task != 3));
    }
}
