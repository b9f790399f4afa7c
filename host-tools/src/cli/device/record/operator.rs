//! The person who moves the stylus: questions on standard error, answers from standard input.

use std::io::BufRead;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use host_tools::support::error::Result;

use crate::cli::interrupt::Interrupt;
use crate::cli::output::tell;

/// Interval at which a wait for an answer looks for Ctrl-C.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// An answer of the operator.
pub enum Answer {
    /// Go on.
    Go,
    /// Skip this trial.
    Skip,
    /// Record this trial again.
    Again,
    /// End the session.
    End,
}

/// The operator at the keyboard.
pub struct Operator {
    interrupt: Interrupt,
    /// Lines of standard input; none if no questions are asked.
    lines: Option<Receiver<String>>,
}

impl Operator {
    /// Listens for Ctrl-C, and for answers if `is_asked`.
    ///
    /// # Errors
    /// See [`Interrupt::listen`].
    pub fn new(is_asked: bool) -> Result<Self> {
        Ok(Self {
            interrupt: Interrupt::listen()?,
            lines: is_asked.then(read_lines),
        })
    }

    /// Returns true once Ctrl-C was pressed.
    pub fn has_interrupted(&self) -> bool {
        self.interrupt.is_raised()
    }

    /// Asks `question` and waits for the answer. Without questions the answer is to go on, until Ctrl-C.
    pub fn ask(&self, question: &str) -> Answer {
        let Some(lines) = &self.lines else {
            return if self.has_interrupted() {
                Answer::End
            } else {
                Answer::Go
            };
        };
        say(&format!("    {question}"));
        loop {
            if self.has_interrupted() {
                return Answer::End;
            }
            match lines.recv_timeout(POLL_INTERVAL) {
                Ok(line) => match line.trim() {
                    "" | "k" => return Answer::Go,
                    "s" => return Answer::Skip,
                    "r" => return Answer::Again,
                    "q" => return Answer::End,
                    other => say(&format!("    '{other}'? {question}")),
                },
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Answer::End,
            }
        }
    }
}

/// Prints to standard error, so that standard output holds the report alone.
pub fn say(text: &str) {
    tell(text);
}

/// Reads the lines of standard input in a thread; the channel ends with the input.
fn read_lines() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let Ok(line) = line else { return };
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}
