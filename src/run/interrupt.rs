//! Ctrl-C: the first asks for an end after what is being computed, the second ends at once.

use std::sync::atomic::{AtomicBool, Ordering};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// The exit code of an interrupted program.
const EXIT_CODE: i32 = 130;

/// Catches Ctrl-C (and a request to terminate) from here on. The store is safe at any moment, so the second may end the program at once.
pub fn install() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            std::process::exit(EXIT_CODE);
        }
        eprintln!("interrupted: finishing what is being computed (again to end at once); a repeat goes on from here");
    })
}

/// In a process that does another's work: the one that gave it says when to end, over its pipe.
pub fn leave_to_the_giver() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {})
}

/// Asks for an end, as Ctrl-C does.
pub fn ask() {
    INTERRUPTED.store(true, Ordering::SeqCst);
}

/// Whether the user asked for an end. Schedulers look before they start a run.
pub fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}
