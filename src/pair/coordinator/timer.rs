//! When the coordinator has to be called, and for what.

/// What the coordinator has to do by itself at some instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timer {
    /// Say hello: mission, plan, home.
    Hello,
    /// Say how we stand.
    Status,
    /// Ask for the peer's clock.
    Clock,
    /// I: repeat the proposal or the commit, or withdraw what was not agreed on in time.
    Proposal,
    /// A START that was not confirmed by both in time is none.
    Start,
    /// I: ask for a lease.
    LeaseRequest,
    /// I: repeat what is said of a motion, or give one up that is too late.
    Motion,
    /// The peer has been silent for too long.
    PeerLost,
}

impl Timer {
    /// For logs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hello => "hello",
            Self::Status => "status",
            Self::Clock => "clock exchange",
            Self::Proposal => "proposal",
            Self::Start => "start expires",
            Self::LeaseRequest => "lease request",
            Self::Motion => "motion",
            Self::PeerLost => "peer lost",
        }
    }
}
