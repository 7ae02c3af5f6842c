//! Commands that want an acknowledgement.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavResult;

use crate::message::CommandLong;

/// Time for an acknowledgement to come before the command is sent again.
pub(crate) const ACK_TIMEOUT: Duration = Duration::from_millis(400);
/// Repetitions after the first time.
pub(crate) const MAX_RETRIES: u8 = 4;
/// Between repetitions of what cannot wait.
const URGENT_INTERVAL: Duration = Duration::from_millis(20);
/// Time for the end of a command that is in progress.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(5);

/// A command on its way.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PendingCommand {
    command: CommandLong,
    confirmation: u8,
    /// When to send next, or to give up.
    due: Duration,
    sent: bool,
    urgent: bool,
}

/// What to do about a pending command now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CommandStep {
    /// Nothing yet.
    Wait,
    /// Send it with this confirmation.
    Send {
        /// Counts the repetitions.
        confirmation: u8,
    },
    /// It was sent often enough without an answer.
    GiveUp,
}

/// What an acknowledgement means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Acknowledgement {
    /// Done, or begun.
    Accepted,
    /// The end is yet to come.
    InProgress,
    /// Not done; it can be tried again later when `temporary`.
    Refused {
        /// The vehicle's answer.
        result: MavResult,
    },
}

impl PendingCommand {
    /// A command to send at once, and if it is urgent as often as there are retries.
    pub(crate) fn new(command: CommandLong, urgent: bool) -> Self {
        Self { command, confirmation: 0, due: Duration::ZERO, sent: false, urgent }
    }

    /// What it asks for.
    pub(crate) fn command(&self) -> &CommandLong {
        &self.command
    }

    /// What is to be done at `now`.
    pub(crate) fn poll(&mut self, now: Duration) -> CommandStep {
        if self.sent && now < self.due {
            return CommandStep::Wait;
        }
        if self.sent {
            if self.confirmation == MAX_RETRIES {
                return CommandStep::GiveUp;
            }
            self.confirmation += 1;
        }
        self.sent = true;
        let last = self.confirmation == MAX_RETRIES;
        self.due = now + if self.urgent && !last { URGENT_INTERVAL } else { ACK_TIMEOUT };
        CommandStep::Send { confirmation: self.confirmation }
    }

    /// What an acknowledgement of this command means.
    pub(crate) fn acknowledge(&mut self, result: MavResult, now: Duration) -> Acknowledgement {
        match result {
            MavResult::MAV_RESULT_ACCEPTED => Acknowledgement::Accepted,
            MavResult::MAV_RESULT_IN_PROGRESS => {
                self.due = now + PROGRESS_TIMEOUT;
                Acknowledgement::InProgress
            }
            result => Acknowledgement::Refused { result },
        }
    }

    /// Whether it was sent more than once: a refusal may then be the answer to a repetition of
    /// what is already being done, so the vehicle's state decides.
    pub(crate) fn was_repeated(&self) -> bool {
        self.confirmation > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_with_rising_confirmation_then_gives_up() {
        let start = Duration::from_secs(7);
        let mut command = PendingCommand::new(CommandLong::arm(), false);
        for retry in 0..=MAX_RETRIES {
            let now = start + ACK_TIMEOUT * u32::from(retry);
            assert_eq!(command.poll(now), CommandStep::Send { confirmation: retry });
            assert_eq!(command.poll(now + ACK_TIMEOUT / 2), CommandStep::Wait);
        }
        let end = start + ACK_TIMEOUT * u32::from(MAX_RETRIES + 1);
        assert_eq!(command.poll(end), CommandStep::GiveUp);
        assert!(end - start <= Duration::from_secs(2), "told within two seconds");
    }

    #[test]
    fn progress_gives_more_time() {
        let mut command = PendingCommand::new(CommandLong::land(), false);
        command.poll(Duration::ZERO);
        let result = MavResult::MAV_RESULT_IN_PROGRESS;
        assert_eq!(command.acknowledge(result, Duration::ZERO), Acknowledgement::InProgress);
        assert_eq!(command.poll(ACK_TIMEOUT * 2), CommandStep::Wait);
    }
}
