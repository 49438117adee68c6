//! Employees and workgroups that pass over to another employer.

use alloc::collections::{BTreeSet, VecDeque};
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::time::Duration;

use super::link::State;
use super::rights::Direction;
use super::types::{
    Ended, Event, Failure, LinkConfig, LinkId, Options, Role, SendError, Sender, Ticket,
};
use super::{Purpose, Station};
use crate::sys::{Outcome, Parameters, Subtype};
use crate::{Address, Content, Mask, PacketType};

/// How long a new employer calls, and how long its employee takes no other.
const PATIENCE: Duration = Duration::from_secs(10);

/// Transfers that wait.
const MAX_WAITING: usize = 1024;

/// As many members as a parameter holds.
const MAX_MEMBERS: usize = 63;

#[derive(Debug, Default)]
pub(super) struct Transfers {
    /// What this station gives away, one after the other.
    giving: VecDeque<Giving>,
    running: bool,
    /// Whom it takes over.
    expected: Vec<Expected>,
    /// The employer that it passes over to, and how long it takes no other.
    reserved: Option<(Address, Duration)>,
    /// Where its PKGCNF is the farewell: employer and place.
    pub(super) leaving: Option<(LinkId, Address, Option<String>)>,
    /// Links to employees that were asked for something, and to the employer if it asked.
    asked: BTreeSet<LinkId>,
    asked_by: BTreeSet<LinkId>,
}

#[derive(Debug)]
struct Giving {
    step: Step,
    to: Address,
    /// Where the new employer listens.
    place: Option<String>,
}

#[derive(Debug)]
enum Step {
    /// The new employer is told of a workgroup.
    Workgroup {
        address: Address,
        mask: Mask,
        members: Vec<Address>,
    },
    /// It is told of an employee.
    Offer(Address),
    /// The employee is told.
    Farewell(Address),
}

#[derive(Debug)]
struct Expected {
    employee: Address,
    given: Address,
    place: Option<String>,
    until: Duration,
    link: Option<LinkId>,
}

impl Transfers {
    pub(super) fn next_timeout(&self) -> Option<Duration> {
        let expected = self.expected.iter().filter(|one| one.link.is_none());
        expected.map(|one| one.until).min()
    }

    /// The address that the employee at the other end of a link gets, if it passes over, and how
    /// long it is called.
    pub(super) fn expected_on(
        &mut self,
        now: Duration,
        link: LinkId,
        config: &LinkConfig,
    ) -> Option<(Address, Duration)> {
        let mut expected = self.expected.iter_mut();
        let one = expected.find(|one| {
            let place = one.place.is_none() || one.place == config.place;
            one.until > now && one.link.is_none_or(|known| known == link) && place
        })?;
        one.link = Some(link);
        Some((one.given, one.until))
    }

    pub(super) fn is_promised(&self, address: Address) -> bool {
        self.expected.iter().any(|one| one.given == address)
    }

    pub(super) fn connected(&mut self, link: LinkId) {
        self.expected.retain(|one| one.link != Some(link));
    }

    pub(super) fn link_lost(&mut self, link: LinkId) {
        for one in &mut self.expected {
            one.link = one.link.filter(|known| *known != link);
        }
        self.asked.remove(&link);
        self.asked_by.remove(&link);
    }

    /// Whether this station passes over to another employer than this one.
    pub(super) fn awaits_other(&self, now: Duration, source: Address) -> bool {
        let mut reserved = self.reserved.into_iter();
        reserved.any(|(employer, until)| employer != source && now < until)
    }

    pub(super) fn arrived(&mut self) {
        self.reserved = None;
    }

    pub(super) fn pass_over(&mut self, now: Duration, employer: Address) {
        self.reserved = Some((employer, now + PATIENCE));
    }

    /// Whether the employee on this link was asked for somebody.
    pub(super) fn was_asked(&self, link: LinkId) -> bool {
        self.asked.contains(&link)
    }

    /// Whether the employer on this link has asked for somebody.
    pub(super) fn is_asked(&self, link: LinkId) -> bool {
        self.asked_by.contains(&link)
    }
}

impl Station {
    /// Gives an employee to another employer: its own, a colleague or another employee. What came
    /// of it is told by [`Event::Transferred`].
    ///
    /// # Errors
    /// If it is no employee, or too many transfers wait.
    pub fn transfer_employee(
        &mut self,
        now: Duration,
        employee: Address,
        to: Address,
        place: Option<&str>,
    ) -> Result<(), SendError> {
        self.employee_link(employee)
            .ok_or(SendError::NoSuchTarget)?;
        self.give_away(Step::Offer(employee), to, place)?;
        self.begin_transfer(now);
        Ok(())
    }

    /// Gives all employees of a workgroup to another employer.
    ///
    /// # Errors
    /// If there is no such workgroup, it has more than 63 members, or too many transfers wait.
    pub fn transfer_workgroup(
        &mut self,
        now: Duration,
        address: Address,
        mask: Mask,
        to: Address,
        place: Option<&str>,
    ) -> Result<(), SendError> {
        self.give_workgroup(address, mask, to, place)?;
        self.begin_transfer(now);
        Ok(())
    }

    /// Asks an employee to give one of its own to another employer, or to this station. Where the
    /// receiver listens may be told.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn request_employee(
        &mut self,
        now: Duration,
        of: Address,
        employee: Address,
        to: Address,
        place: Option<&str>,
    ) -> Result<Ticket, SendError> {
        let parameters = Parameters {
            address: Some(employee),
            employer: Some(to),
            place,
            ..Parameters::default()
        };
        self.request(now, of, Subtype::EmployeeRequest, parameters)
    }

    /// Asks an employee to give one of its workgroups to another employer, or to this station.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn request_workgroup(
        &mut self,
        now: Duration,
        of: Address,
        address: Address,
        mask: Mask,
        to: Address,
    ) -> Result<Ticket, SendError> {
        let parameters = Parameters {
            address: Some(address),
            mask: Some(mask),
            employer: Some(to),
            ..Parameters::default()
        };
        self.request(now, of, Subtype::WorkgroupRequest, parameters)
    }

    fn request(
        &mut self,
        now: Duration,
        of: Address,
        subtype: Subtype,
        parameters: Parameters<'_>,
    ) -> Result<Ticket, SendError> {
        let link = self.employee_link(of).ok_or(SendError::NotPermitted)?;
        let content = Content::System {
            subtype,
            parameters,
        };
        let ticket = self.send(now, None, of, &content, Options::CONFIRMED)?;
        self.transfers.asked.insert(link);
        Ok(ticket)
    }

    fn employee_link(&self, employee: Address) -> Option<LinkId> {
        let id = self.way_down(employee)?;
        let link = self.links.get(&id)?;
        (link.peer == employee).then_some(id)
    }

    fn give_away(&mut self, step: Step, to: Address, place: Option<&str>) -> Result<(), SendError> {
        if self.transfers.giving.len() >= MAX_WAITING {
            return Err(SendError::Full);
        }
        let place = place.map(str::to_string);
        self.transfers.giving.push_back(Giving { step, to, place });
        Ok(())
    }

    fn give_workgroup(
        &mut self,
        address: Address,
        mask: Mask,
        to: Address,
        place: Option<&str>,
    ) -> Result<(), SendError> {
        let known = |group: &super::Workgroup| (group.address, group.mask) == (address, mask);
        let group = self.config.workgroups.iter().position(known);
        let group = group.ok_or(SendError::NoSuchTarget)?;
        let links = self.links.values().filter(|link| {
            let member = link.role == Role::Employer && link.group == group;
            member && link.is_connected() && link.peer != to
        });
        let mut members: Vec<Address> = links.map(|link| link.peer).collect();
        members.sort();
        if members.len() > MAX_MEMBERS {
            return Err(SendError::TooLong);
        }
        let step = Step::Workgroup {
            address,
            mask,
            members,
        };
        self.give_away(step, to, place)
    }

    /// Takes the next step of the first transfer that waits.
    pub(super) fn begin_transfer(&mut self, now: Duration) {
        while !self.transfers.running
            && let Some(giving) = self.transfers.giving.front()
        {
            let (to, place) = (giving.to, giving.place.clone());
            let octets: Vec<u8>;
            let (target, subtype, parameters) = match &giving.step {
                Step::Workgroup {
                    address,
                    mask,
                    members,
                } => {
                    octets = members.iter().flat_map(|member| member.octets()).collect();
                    let parameters = Parameters {
                        address: Some(*address),
                        mask: Some(*mask),
                        members: Some(&octets),
                        ..Parameters::default()
                    };
                    (to, Subtype::WorkgroupTransfer, parameters)
                }
                Step::Offer(employee) => {
                    let link = self.employee_link(*employee);
                    let link = link.and_then(|link| self.links.get(&link));
                    let parameters = Parameters {
                        address: Some(*employee),
                        mask: link.and_then(|link| link.mask),
                        place: link.and_then(|link| link.config.place.as_deref()),
                        ..Parameters::default()
                    };
                    (to, Subtype::EmployeeTransfer, parameters)
                }
                Step::Farewell(employee) => {
                    let parameters = Parameters {
                        address: Some(*employee),
                        place: place.as_deref(),
                        ..Parameters::default()
                    };
                    (*employee, Subtype::EmployeeTransfer, parameters)
                }
            };
            let parameters = Parameters {
                employer: Some(to),
                ..parameters
            };
            let content = Content::System {
                subtype,
                parameters,
            };
            let data = Self::data_of(&content).unwrap_or_default();
            self.transfers.running = true;
            let (ends, kind) = ((None, target), PacketType::SYS);
            let sent = self.send_data(now, ends, kind, data, Options::CONFIRMED, Purpose::Transfer);
            if let Err(error) = sent {
                let outcome = match error {
                    SendError::NotPermitted => Outcome::NOT_PERMITTED,
                    _ => Outcome::NO_SUCH_TARGET,
                };
                self.finish_step(now, Err(Failure::Refused(outcome, Some(error.to_string()))));
            }
        }
    }

    /// The step that was taken is confirmed, or has failed.
    pub(super) fn transfer_step(&mut self, now: Duration, result: Result<(), Failure>) {
        self.finish_step(now, result);
        self.begin_transfer(now);
    }

    fn finish_step(&mut self, now: Duration, result: Result<(), Failure>) {
        self.transfers.running = false;
        let Some(Giving { step, to, place }) = self.transfers.giving.pop_front() else {
            return;
        };
        match (step, result) {
            (Step::Workgroup { members, .. }, Ok(())) => {
                for member in members.into_iter().rev() {
                    self.transfers.giving.push_front(Giving {
                        step: Step::Offer(member),
                        to,
                        place: place.clone(),
                    });
                }
            }
            (Step::Workgroup { address, .. }, result) => {
                self.tell_transfer(address, to, result);
            }
            (Step::Offer(employee), Ok(())) => {
                let step = Step::Farewell(employee);
                self.transfers.giving.push_front(Giving { step, to, place });
            }
            (Step::Farewell(employee), Ok(())) => {
                if let Some(id) = self.employee_link(employee) {
                    let closes = self.links.get(&id).is_some_and(|link| link.config.closes);
                    self.end_connection(now, id, Ended::Transferred, false);
                    if closes {
                        self.events.push_back(Event::Close(id));
                    }
                }
                self.tell_transfer(employee, to, Ok(()));
            }
            (Step::Offer(employee) | Step::Farewell(employee), result) => {
                self.tell_transfer(employee, to, result);
            }
        }
        if self.transfers.giving.is_empty() {
            self.transfers.asked_by.clear();
        }
    }

    fn tell_transfer(&mut self, employee: Address, to: Address, result: Result<(), Failure>) {
        self.events.push_back(Event::Transferred {
            employee,
            to,
            result,
        });
    }

    /// A transfer or a request came.
    pub(super) fn transfer(
        &mut self,
        now: Duration,
        from: Sender,
        subtype: Subtype,
        read: &Parameters<'_>,
    ) -> Outcome {
        let (Some(address), Some(to)) = (read.address, read.employer) else {
            return Outcome::MALFORMED;
        };
        match subtype {
            Subtype::EmployeeTransfer => {
                if from.direction == Direction::Employee && address == from.to {
                    let place = read.place.map(str::to_string);
                    self.transfers.leaving = Some((from.link, to, place));
                    return Outcome::ACCEPTED;
                }
                if !self.is_own(to) {
                    return Outcome::NO_SUCH_TARGET;
                }
                match read.mask {
                    Some(mask) => self.expect(now, address, mask, read.place),
                    None => Outcome::MALFORMED,
                }
            }
            Subtype::WorkgroupTransfer => {
                if !self.is_own(to) {
                    return Outcome::NO_SUCH_TARGET;
                }
                if read.mask.is_none() || read.members.is_none() {
                    return Outcome::MALFORMED;
                }
                match self.free_levels(read.members().count()) {
                    true => Outcome::ACCEPTED,
                    false => Outcome::REFUSED,
                }
            }
            Subtype::EmployeeRequest => {
                if self.employee_link(address).is_none() {
                    return Outcome::NO_SUCH_TARGET;
                }
                self.asked(from.link, |station| {
                    station.give_away(Step::Offer(address), to, read.place)
                })
            }
            Subtype::WorkgroupRequest => match read.mask {
                Some(mask) => self.asked(from.link, |station| {
                    station.give_workgroup(address, mask, to, read.place)
                }),
                None => Outcome::MALFORMED,
            },
            _ => Outcome::NOT_PERMITTED,
        }
    }

    fn asked(
        &mut self,
        by: LinkId,
        give: impl FnOnce(&mut Station) -> Result<(), SendError>,
    ) -> Outcome {
        match give(self) {
            Ok(()) => {
                self.transfers.asked_by.insert(by);
                Outcome::ACCEPTED
            }
            Err(SendError::NoSuchTarget) => Outcome::NO_SUCH_TARGET,
            Err(_) => Outcome::REFUSED,
        }
    }

    fn is_own(&self, address: Address) -> bool {
        let up = self.up.and_then(|up| self.links.get(&up));
        self.address == Some(address)
            || up.is_some_and(|link| link.local == address)
            || self
                .config
                .workgroups
                .iter()
                .any(|group| group.address == address)
    }

    /// Whether this many more employees can have an address.
    fn free_levels(&self, count: usize) -> bool {
        let free = self.config.workgroups.iter().flat_map(|group| {
            let levels = 1..group.mask.broadcast();
            levels.filter_map(|level| group.mask.address(group.address, level))
        });
        free.filter(|address| self.is_free(*address))
            .take(count)
            .count()
            == count
    }

    /// Takes an employee over: calls it on a stream of its own from now on.
    fn expect(
        &mut self,
        now: Duration,
        employee: Address,
        mask: Mask,
        place: Option<&str>,
    ) -> Outcome {
        self.transfers
            .expected
            .retain(|one| one.employee != employee);
        let level = Some(mask.level(employee));
        let groups = 0..self.config.workgroups.len();
        let kept = |group: usize| {
            let own = self.config.workgroups.get(group)?;
            let kept = own.mask.address(own.address, level?)?;
            self.free_in(group, level).filter(|free| *free == kept)
        };
        let given = groups.clone().find_map(kept);
        let given = given.or_else(|| groups.clone().find_map(|group| self.free_in(group, None)));
        let idle = self.idle_link(place);
        let reachable = place.is_some() || self.config.listens || idle.is_some();
        let Some(given) = given.filter(|_| reachable) else {
            return Outcome::REFUSED;
        };
        self.transfers.expected.push(Expected {
            employee,
            given,
            place: place.map(str::to_string),
            until: now + PATIENCE,
            link: None,
        });
        match idle {
            Some(link) => self.start_calling(now, link),
            None => self.events.push_back(Event::Expect {
                employee,
                place: place.map(str::to_string),
            }),
        }
        Outcome::ACCEPTED
    }

    /// A stream on which somebody refused to be employed, and which is that of this employee.
    fn idle_link(&self, place: Option<&str>) -> Option<LinkId> {
        let idle = self.links.iter().filter(|(_, link)| {
            let refused = link.role == Role::Employer && link.state == State::Idle;
            refused && place.is_none_or(|place| link.config.place.as_deref() == Some(place))
        });
        let mut ids = idle.map(|(id, _)| *id);
        match (ids.next(), ids.next()) {
            (Some(id), None) => Some(id),
            _ => None,
        }
    }

    /// An employee that was to pass over has not.
    pub(super) fn not_passed_over(&mut self, id: LinkId) {
        self.transfers.connected(id);
        self.events.push_back(Event::ConnectionRefused {
            link: id,
            outcome: Outcome::REFUSED,
            reason: Some("it did not pass over in time".to_string()),
        });
        if self.links.get(&id).is_some_and(|link| link.config.closes) {
            self.events.push_back(Event::Close(id));
        }
    }

    pub(super) fn transfer_timeout(&mut self, now: Duration) {
        let waits = |one: &Expected| one.link.is_some() || one.until > now;
        self.transfers.expected.retain(waits);
    }
}
