//! The terminal: taken over, drawn on, and always given back, whatever ends the view (a key, a signal, a panic, a pipe that is
//! closed).

use std::collections::VecDeque;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::Duration;

use crossterm::cursor::{Hide, Show};
use crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use crossterm::terminal::{self, EnterAlternateScreen, LeaveAlternateScreen};
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;

use crate::desk::watch::view::{Theme, draw};
use crate::desk::watch::{After, Key, State};
use crate::link::{Aboard, Clock};

use super::station::{Port, Station};

/// Drawn this often at the least, and no more often than messages make a picture worth looking at.
const EVERY: Duration = Duration::from_millis(100);
/// What is due to be sent is looked for this often.
const TICK: Duration = Duration::from_millis(20);
/// The keys' thread looks whether it is still wanted this often.
const KEYS_EVERY: Duration = Duration::from_millis(50);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);

/// The terminal is ours.
static TAKEN: AtomicBool = AtomicBool::new(false);
/// What would have been said on stderr meanwhile; nothing of it is kept while the terminal is nobody's.
static ASIDE: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());
/// So many lines wait for the view at the most.
const MOST_ASIDE: usize = 200;

/// Whether there is a terminal that can be drawn on.
///
/// # Errors
/// Why not, in words.
pub(in crate::cli) fn is_possible() -> Result<(), String> {
    if !io::stdout().is_terminal() {
        return Err("watch draws on a terminal, and stdout is none: run it in one. For a pipe there are the log of `veilwing fly`, and `veilwing report` for a recorded flight".into());
    }
    match std::env::var_os("TERM") {
        Some(term) if term != "dumb" => Ok(()),
        _ => {
            Err("watch draws on a terminal, and TERM says that this one is dumb: set TERM if it is not"
                .into())
        }
    }
}

/// Whether a view has the terminal.
pub(in crate::cli) fn is_shown() -> bool {
    TAKEN.load(Ordering::SeqCst)
}

/// A line that would go to stderr: taken by the view if there is one.
pub(in crate::cli) fn aside(text: &str) -> bool {
    if !TAKEN.load(Ordering::SeqCst) {
        return false;
    }
    let mut lines = ASIDE.lock().unwrap_or_else(PoisonError::into_inner);
    if lines.len() < MOST_ASIDE {
        lines.push_back(text.to_owned());
    }
    true
}

/// Whether a view may take over the terminal in this process: stderr's log must then ask [`aside`] first.
pub(in crate::cli) fn takes_over() -> impl Fn() -> Aside + Send + Sync + 'static {
    || Aside(Vec::new())
}

/// One line of the log: to the view, or to stderr.
pub(in crate::cli) struct Aside(Vec<u8>);

impl Write for Aside {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if !aside(without_escapes(&String::from_utf8_lossy(&self.0)).trim_end()) {
            let _ = io::stderr().lock().write_all(&self.0);
        }
    }
}

/// A line of the log without the sequences that colour it.
fn without_escapes(text: &str) -> String {
    let mut parts = text.split("\u{1B}[");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |line, part| {
        line + part.trim_start_matches(|c: char| !c.is_ascii_alphabetic()).get(1..).unwrap_or_default()
    })
}

/// Gives the terminal back, once.
fn give_back() {
    if TAKEN.swap(false, Ordering::SeqCst) {
        let _ = crossterm::execute!(io::stdout(), LeaveAlternateScreen, Show);
        let _ = terminal::disable_raw_mode();
    }
}

/// The terminal, taken over until it is dropped.
pub(in crate::cli) struct Screen {
    terminal: Terminal<CrosstermBackend<io::Stdout>>,
    theme: Theme,
    keys: mpsc::UnboundedReceiver<Pressed>,
    wanted: Arc<AtomicBool>,
}

/// What the keyboard, or the terminal itself, has done.
enum Pressed {
    Key(Key),
    Resized,
    /// It is gone.
    Gone,
}

impl Screen {
    /// Takes the terminal over.
    ///
    /// # Errors
    /// It cannot be, in words.
    pub fn open() -> Result<Self, String> {
        is_possible()?;
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let before = std::panic::take_hook();
            // First, so that what a panic says can be read.
            std::panic::set_hook(Box::new(move |panic| {
                give_back();
                before(panic);
            }));
        });
        let failed = |error: io::Error| {
            give_back();
            format!("this terminal cannot be drawn on: {error}")
        };
        TAKEN.store(true, Ordering::SeqCst);
        terminal::enable_raw_mode().map_err(failed)?;
        crossterm::execute!(io::stdout(), EnterAlternateScreen, Hide).map_err(failed)?;
        let terminal = Terminal::new(CrosstermBackend::new(io::stdout())).map_err(failed)?;
        let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        let (send, keys) = mpsc::unbounded_channel();
        let wanted = Arc::new(AtomicBool::new(true));
        let alive = Arc::clone(&wanted);
        std::thread::spawn(move || read_keys(&alive, &send));
        Ok(Self { terminal, theme: Theme { colours }, keys, wanted })
    }

    /// Shows the state until the operator leaves (`Some`), a signal comes (`None`), or `over` is set. `alone`: Ctrl-C and
    /// SIGTERM are the view's to hear, and nobody else's in this process.
    ///
    /// # Errors
    /// The terminal takes nothing any more.
    pub async fn run(
        &mut self,
        mut state: State,
        mut ports: Vec<Port>,
        clock: &Clock,
        station: Option<Station>,
        alone: bool,
        over: &AtomicBool,
    ) -> io::Result<Option<After>> {
        let mut hangup = signal(SignalKind::hangup())?;
        let mut quit = signal(SignalKind::quit())?;
        let mut stopped = std::pin::pin!(async {
            match alone {
                true => crate::cli::interrupt::requested().await,
                false => std::future::pending().await,
            }
        });
        let mut tick = tokio::time::interval(TICK);
        tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let (mut drawn_at, mut beat_at) = (None, clock.now());
        loop {
            let mut urgent = false;
            tokio::select! {
                biased;
                () = &mut stopped => return Ok(None),
                _ = hangup.recv() => return Ok(None),
                _ = quit.recv() => return Ok(None),
                pressed = self.keys.recv() => match pressed {
                    Some(Pressed::Key(key)) => {
                        urgent = true;
                        match state.key(key, clock.now()) {
                            After::Stay => {}
                            after => return Ok(Some(after)),
                        }
                    }
                    Some(Pressed::Resized) => urgent = true,
                    Some(Pressed::Gone) | None => return Ok(None),
                },
                (channel, header, message) = heard(&mut ports) => {
                    if let Aboard::Common(message) = &message {
                        state.take(channel, header, message, clock.now());
                    }
                    // A burst is one picture; a flood must not hold up what is due.
                    if drawn_at.is_some_and(|at| at + TICK > clock.now()) {
                        continue;
                    }
                }
                _ = tick.tick() => {}
            }
            if over.load(Ordering::SeqCst) {
                return Ok(Some(After::Leave));
            }
            let now = clock.now();
            let lines: Vec<String> = ASIDE.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect();
            lines.into_iter().for_each(|line| state.remark(line, now));
            state.advance(now);
            if let Some(station) = &station {
                while let Some((channel, message)) = state.poll_transmit(now) {
                    urgent = true;
                    if let Some(port) = ports.get_mut(channel) {
                        port.send(station.own, &message);
                    }
                }
                if let Some(heartbeat) = station.heartbeat.as_ref().filter(|_| now >= beat_at) {
                    beat_at = now + HEARTBEAT_EVERY;
                    ports.iter_mut().for_each(|port| port.send(station.own, heartbeat));
                }
            }
            if urgent || drawn_at.is_none_or(|at| at + EVERY <= now) {
                drawn_at = Some(now);
                let theme = self.theme;
                self.terminal.draw(|frame| draw(&state, now, theme, frame))?;
            }
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.wanted.store(false, Ordering::SeqCst);
        give_back();
        // What came while it was drawn is said now.
        for line in ASIDE.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            eprintln!("{line}");
        }
    }
}

/// The next message on any port; never without one.
async fn heard(ports: &mut [Port]) -> (usize, mavlink::MavHeader, Aboard) {
    let mut next: Vec<_> = ports.iter_mut().map(|port| Box::pin(port.recv())).collect();
    std::future::poll_fn(|cx| {
        for (channel, next) in next.iter_mut().enumerate() {
            if let std::task::Poll::Ready((header, message)) = next.as_mut().poll(cx) {
                return std::task::Poll::Ready((channel, header, message));
            }
        }
        std::task::Poll::Pending
    })
    .await
}

/// Until nobody wants them any more.
fn read_keys(wanted: &AtomicBool, send: &mpsc::UnboundedSender<Pressed>) {
    while wanted.load(Ordering::SeqCst) {
        let pressed = match event::poll(KEYS_EVERY) {
            Ok(false) => continue,
            Ok(true) => match event::read() {
                Ok(Event::Key(key)) if key.kind != KeyEventKind::Release => {
                    let Some(key) = key_of(key.code, key.modifiers) else { continue };
                    Pressed::Key(key)
                }
                Ok(Event::Resize(..)) => Pressed::Resized,
                Ok(_) => continue,
                Err(_) => Pressed::Gone,
            },
            Err(_) => Pressed::Gone,
        };
        let gone = matches!(pressed, Pressed::Gone);
        if send.send(pressed).is_err() || gone {
            return;
        }
    }
}

fn key_of(code: KeyCode, modifiers: KeyModifiers) -> Option<Key> {
    if modifiers.contains(KeyModifiers::CONTROL) {
        return matches!(code, KeyCode::Char('c' | 'C' | 'd' | 'D')).then_some(Key::Interrupt);
    }
    Some(match code {
        KeyCode::Char(character) => Key::Char(character),
        KeyCode::Enter => Key::Enter,
        KeyCode::Esc => Key::Escape,
        KeyCode::Tab | KeyCode::BackTab => Key::Tab,
        KeyCode::Left => Key::Left,
        KeyCode::Right => Key::Right,
        KeyCode::Up => Key::Up,
        KeyCode::Down => Key::Down,
        KeyCode::PageUp => Key::PageUp,
        KeyCode::PageDown => Key::PageDown,
        KeyCode::Home => Key::Home,
        KeyCode::End => Key::End,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_coloured_line_of_the_log_comes_through_plain() {
        assert_eq!(
            without_escapes("\u{1B}[2m12:00\u{1B}[0m \u{1B}[33m WARN\u{1B}[0m link is down"),
            "12:00  WARN link is down"
        );
        assert_eq!(without_escapes("plain"), "plain");
    }
}
