//! Who may say what to whom.

use crate::content::MessageKind;
use crate::sys::Subtype;
use crate::{PacketType, content::BarrierOperation};

/// What a receiver is to the sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// The employer, directly above.
    Employer,
    /// One of the same workgroup.
    Colleague,
    /// Directly below.
    Employee,
    /// Below, not directly.
    Subemployee,
}

/// The longest packet to whom nothing is known about: a subemployee, a colleague without
/// connection, a broadcast.
pub(super) const SHORT: usize = 64;

/// Whether a packet of this type, with this data, may be sent in this direction. `requested`: the
/// employer has asked for an employee or a workgroup.
pub(super) fn permitted(
    direction: Direction,
    kind: PacketType,
    data: &[u8],
    confirm: bool,
    requested: bool,
) -> bool {
    let first = data.first().copied();
    let command = kind == PacketType::MSG && first == Some(MessageKind::Command as u8);
    match direction {
        Direction::Employee => true,
        Direction::Colleague => {
            let system = [
                Subtype::Confirmation,
                Subtype::Initialize,
                Subtype::Accept,
                Subtype::Refuse,
                Subtype::EmployeeTransfer,
                Subtype::WorkgroupTransfer,
            ];
            !command && (kind != PacketType::SYS || is_one_of(first, &system))
        }
        Direction::Employer => {
            let transfer = [Subtype::EmployeeTransfer, Subtype::WorkgroupTransfer];
            match kind {
                PacketType::MSG => !command,
                // With a number of parties it sets the barrier up.
                PacketType::SYNC => {
                    let arrives = first == Some(BarrierOperation::Arrive as u8);
                    !(arrives && data.get(3).is_some_and(|parties| *parties != 0))
                }
                PacketType::SYS => {
                    is_one_of(first, &[Subtype::Confirmation])
                        || (requested && is_one_of(first, &transfer))
                }
                _ => true,
            }
        }
        // One way: a command with a reference wants an answer.
        Direction::Subemployee => {
            let one_way = command && data.get(1) == Some(&0);
            !confirm && (kind == PacketType::SIG || one_way)
        }
    }
}

fn is_one_of(first: Option<u8>, subtypes: &[Subtype]) -> bool {
    subtypes.iter().any(|known| first == Some(*known as u8))
}
