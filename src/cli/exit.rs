use std::fmt;

use crate::input::InputError;
use crate::run::StoreError;

/// How a command ends. The numbers are a contract: scripts and CI read them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    Ok = 0,
    /// The program's own fault, or the disk's.
    Internal = 1,
    Usage = 2,
    InvalidInput = 3,
    NothingSelected = 4,
    /// No usable GPU where one was demanded.
    NoGpu = 5,
    RunsFailed = 100,
    /// A regression, or a threshold exceeded.
    Regression = 101,
    BaselineMissing = 102,
    /// Interrupted; what was finished is kept.
    Interrupted = 130,
}

impl Exit {
    /// Every exit, the one that wins over all others first.
    pub const PRECEDENCE: [Exit; 10] = [
        Exit::Interrupted,
        Exit::Internal,
        Exit::Usage,
        Exit::InvalidInput,
        Exit::NothingSelected,
        Exit::NoGpu,
        Exit::RunsFailed,
        Exit::BaselineMissing,
        Exit::Regression,
        Exit::Ok,
    ];

    /// The exit of a command in which both happened.
    pub fn and(self, other: Exit) -> Exit {
        let rank = |exit: Exit| Exit::PRECEDENCE.iter().position(|e| *e == exit);
        if rank(other) < rank(self) { other } else { self }
    }

    pub fn code(self) -> u8 {
        self as u8
    }

    /// What the number says, for the manual.
    pub fn meaning(self) -> &'static str {
        match self {
            Exit::Ok => "success",
            Exit::Internal => "internal error",
            Exit::Usage => "wrong usage of the command line",
            Exit::InvalidInput => "an input file is invalid",
            Exit::NothingSelected => "nothing was selected",
            Exit::NoGpu => "no usable GPU where one was demanded",
            Exit::RunsFailed => "some runs failed",
            Exit::Regression => "a regression, or a threshold was exceeded",
            Exit::BaselineMissing => "the baseline is missing",
            Exit::Interrupted => "interrupted; a repeat goes on from here",
        }
    }
}

/// Why a command stopped before its end.
#[derive(Debug)]
pub struct Failure {
    pub exit: Exit,
    pub message: String,
}

impl Failure {
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into() }
    }
    pub fn usage(message: impl Into<String>) -> Self {
        Self::new(Exit::Usage, message)
    }
    pub fn internal(error: impl fmt::Display) -> Self {
        Self::new(Exit::Internal, error.to_string())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::new(Exit::InvalidInput, error.to_string())
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self::internal(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precedence_is_130_1_5_100_102_101() {
        let order = [130, 1, 5, 100, 102, 101, 0];
        let exits: Vec<Exit> =
            order.iter().map(|code| *Exit::PRECEDENCE.iter().find(|e| e.code() == *code).unwrap()).collect();
        for (i, first) in exits.iter().enumerate() {
            for later in &exits[i..] {
                assert_eq!(first.and(*later), *first);
                assert_eq!(later.and(*first), *first);
            }
        }
    }
}
