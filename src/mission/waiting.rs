//! What a vehicle on the ground waits for: when it is worth a line to the operator.

use std::time::Duration;

use crate::time::Instant;

/// What has settled by itself before this is no news.
const SETTLED: Duration = Duration::from_secs(1);
/// What never settles is told this often.
const RESTLESS: Duration = Duration::from_secs(5);
/// What goes on failing is told again this often: a ground station may have come late.
const AGAIN: Duration = Duration::from_secs(30);

/// What is waited for, and what of it has been told.
#[derive(Debug, Clone, Default)]
pub(super) struct Waiting {
    /// The present text and since when it is that.
    now: Option<(String, Instant)>,
    told: Option<(String, Instant)>,
}

impl Waiting {
    /// Takes in what is waited for at `now`; gives it back if the operator should be told.
    pub fn news(&mut self, text: &str, now: Instant) -> Option<String> {
        let since = match &self.now {
            Some((before, since)) if before == text => *since,
            before => {
                let first = before.is_none();
                self.now = Some((text.to_owned(), now));
                if first {
                    // The first line comes a moment after the wait has begun, whatever it says by then.
                    self.told = Some((String::new(), now));
                }
                now
            }
        };
        let (last, told_at) = self.told.as_ref()?;
        let due = now >= since + SETTLED || now >= *told_at + RESTLESS;
        (due && last != text).then(|| {
            self.told = Some((text.to_owned(), now));
            text.to_owned()
        })
    }

    /// What was told last, if that is long ago.
    pub fn again(&mut self, now: Instant) -> Option<String> {
        let (text, told_at) =
            self.told.as_mut().filter(|(text, at)| !text.is_empty() && now >= *at + AGAIN)?;
        *told_at = now;
        Some(text.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::default() + Duration::from_millis(ms)
    }

    #[test]
    fn spec_one_line_a_change_and_none_for_what_passes_at_once() {
        let mut waiting = Waiting::default();
        let heard = [
            (0, "plan, peer", None),
            (400, "plan", None),
            (600, "peer", None),
            (1500, "peer", None),
            (1600, "peer", Some("peer")),
            (9000, "peer", None),
            (9100, "gps", Some("gps")),
            (9200, "peer", None),
            (10_300, "peer", Some("peer")),
        ];
        for (ms, text, told) in heard {
            assert_eq!(waiting.news(text, at(ms)).as_deref(), told, "{ms}");
        }
    }

    #[test]
    fn spec_what_stays_is_told_again_every_half_minute() {
        let mut waiting = Waiting::default();
        assert_eq!(waiting.again(at(0)), None);
        let again = (0..1000).filter(|k| {
            waiting.news("gps", at(k * 100));
            waiting.again(at(k * 100)).is_some()
        });
        assert_eq!(again.collect::<Vec<_>>(), [310, 610, 910]);
    }

    #[test]
    fn spec_what_never_settles_is_told_every_five_seconds() {
        let mut waiting = Waiting::default();
        let told = (0..300).filter(|k| waiting.news(&format!("{k} Hz"), at(k * 100)).is_some()).count();
        assert_eq!(told, 5);
    }
}
