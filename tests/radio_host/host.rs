//! The program `veilwing radio` with a companion's end of the link, over loopback.

use std::process::{Child, Command, Stdio};

use mavlink::dialects::ardupilotmega::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult, TIMESYNC_DATA,
};
use veilwing::link::{Aboard, Clock, Frame, HostPort, Key, Link, LinkAddress, LinkConfig, SigningConfig};
use veilwing::transmitter::wire::{MavMessage as Radio, VEILWING_RADIO_DATA, VeilwingRadioResult as Is};

use crate::backends::directory;

pub const OWN: (u8, u8) = (1, 68);
pub const COMPANION: (u8, u8) = (1, 191);

/// A port that was free just now.
pub fn free_port() -> u16 {
    std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// The program, with a device made of shell scripts in its directory.
pub struct Program {
    pub child: Child,
    pub directory: std::path::PathBuf,
    pub port: u16,
}

impl Program {
    pub fn start(name: &str, link: &str) -> Self {
        let directory = directory(name);
        let at = directory.display();
        let device = format!(
            "kind = \"command\"\nleast = 0\nmost = 30\noff_ms = 2000\nchange_ms = 2000\n\
             [command]\n\
             set = [\"sh\", \"-c\", \"echo $1 > $0/power; echo on $1 >> $0/history\", \"{at}\", \"{{dbm}}\"]\n\
             read = [\"cat\", \"{at}/power\"]\n\
             off = [\"sh\", \"-c\", \"echo off > $0/power; echo off >> $0/history\", \"{at}\"]\n\
             read_off = [\"cat\", \"{at}/power\"]\noff_reads = \"off\"\n"
        );
        Self::with(directory, link, &device)
    }

    /// The program with a device of anybody's: the file from its kind on.
    pub fn of(name: &str, device: &str) -> Self {
        Self::with(directory(name), "", device)
    }

    fn with(directory: std::path::PathBuf, link: &str, device: &str) -> Self {
        let port = free_port();
        let at = directory.display();
        let text = format!(
            "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:{port}\"\ncommanders = [191]\n{link}\n\
             [device]\n{device}[log]\ndir = \"{at}/logs\"\n"
        );
        std::fs::write(directory.join("radio.toml"), text).unwrap();
        let child = Self::spawn(&directory);
        Self { child, directory, port }
    }

    fn spawn(directory: &std::path::Path) -> Child {
        Command::new(env!("CARGO_BIN_EXE_veilwing"))
            .arg("radio")
            .arg(directory.join("radio.toml"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(directory.join("stderr")).unwrap())
            .spawn()
            .unwrap()
    }

    pub fn again(&mut self) {
        self.child = Self::spawn(&self.directory);
    }

    pub fn history(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.directory.join("history")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }

    pub fn said(&self) -> String {
        std::fs::read_to_string(self.directory.join("stderr")).unwrap_or_default()
    }

    /// Asks it to end, and its exit code.
    pub fn terminate(&mut self) -> Option<i32> {
        let pid = rustix::process::Pid::from_raw(self.child.id().cast_signed()).unwrap();
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        self.child.wait().unwrap().code()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}

/// The companion's end of the link.
pub struct Companion {
    pub link: Link<Aboard>,
    clock: Clock,
    number: u32,
    boot: u32,
    pub series: u32,
    pub time_ms: u32,
    /// Every STATUSTEXT.
    pub texts: Vec<String>,
}

pub fn key(byte: u8, state_file: std::path::PathBuf) -> SigningConfig {
    SigningConfig { key: Key::new([byte; 32]), link_id: 2, state_file, unsigned_allowed: Vec::new() }
}

impl Companion {
    pub async fn new(port: u16, boot: u32, signing: Option<SigningConfig>) -> Self {
        let clock = Clock::real();
        let address = LinkAddress::UdpOut(HostPort { host: "127.0.0.1".to_owned(), port });
        let config =
            LinkConfig { name: "radio".to_owned(), peer_system: Some(1), signing, ..LinkConfig::default() };
        let link = Link::open(address, config, clock.clone()).await.unwrap();
        Self { link, clock, number: 0, boot, series: 0, time_ms: 0, texts: Vec::new() }
    }

    pub fn say(&mut self, message: MavMessage) {
        self.link.send(COMPANION, &Aboard::Common(message));
    }

    /// The next thing that the radio says. A companion that asks a radio that learns its address is heard by it; this one
    /// says something at least every 20 ms.
    pub async fn hear(&mut self) -> Aboard {
        loop {
            let again = self.clock.now() + std::time::Duration::from_millis(20);
            let heard: Option<Frame<Aboard>> = tokio::select! {
                biased;
                frame = self.link.recv() => Some(frame),
                () = self.clock.sleep_until(again) => None,
            };
            match heard.map(|frame| frame.message) {
                None => self.say(MavMessage::HEARTBEAT(Default::default())),
                // As the transmitter's driver does.
                Some(Aboard::Common(MavMessage::TIMESYNC(asked))) if asked.tc1 == 0 => {
                    self.say(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 1, ..asked }));
                }
                Some(Aboard::Radio(said)) => {
                    let Radio::VEILWING_RADIO(report) = said.message();
                    (self.series, self.time_ms) = (report.series, report.time_ms);
                    return Aboard::Radio(said);
                }
                Some(other) => {
                    if let Aboard::Common(MavMessage::STATUSTEXT(said)) = &other {
                        self.texts.push(said.text.to_str().unwrap().to_owned());
                    }
                    return other;
                }
            }
        }
    }

    pub async fn report(&mut self) -> VEILWING_RADIO_DATA {
        loop {
            if let Aboard::Radio(said) = self.hear().await {
                let Radio::VEILWING_RADIO(report) = said.message();
                return report.clone();
            }
        }
    }

    pub fn command(&mut self, dbm: f32, ahead_ms: u32) -> COMMAND_INT_DATA {
        self.number += 1;
        COMMAND_INT_DATA {
            param1: dbm,
            param2: self.number as f32,
            param3: self.boot as f32,
            param4: self.series as f32,
            y: self.time_ms.wrapping_add(ahead_ms).cast_signed(),
            command: MavCmd::MAV_CMD_USER_1,
            target_system: OWN.0,
            target_component: OWN.1,
            ..COMMAND_INT_DATA::DEFAULT
        }
    }

    /// Commands, and the answer.
    pub async fn give(&mut self, dbm: f32, ahead_ms: u32) -> VEILWING_RADIO_DATA {
        let command = self.command(dbm, ahead_ms);
        self.say(MavMessage::COMMAND_INT(command));
        self.answer(self.number).await
    }

    pub async fn answer(&mut self, number: u32) -> VEILWING_RADIO_DATA {
        loop {
            let report = self.report().await;
            if (report.answers_boot, report.answers) == (self.boot, number) {
                return report;
            }
        }
    }
}

#[tokio::test]
async fn spec_a_power_is_given_read_back_ends_by_itself_and_ends_with_the_program() {
    let mut program = Program::start("whole", "");
    let mut companion = Companion::new(program.port, 5, None).await;
    companion.report().await;
    assert_eq!(companion.give(f32::NEG_INFINITY, 0).await.power_mdbm, i32::MIN);
    assert_eq!(program.history()[0], "off", "the first thing that it did");
    let answer = companion.give(20.7, 4000).await;
    assert_eq!(
        (answer.result, answer.power_mdbm),
        (Is::VEILWING_RADIO_RESULT_ACCEPTED, 20_000),
        "{}",
        program.said()
    );
    // Left alone, it runs out.
    while companion.report().await.power_mdbm != i32::MIN {}
    assert_eq!(program.history()[program.history().len() - 2..], ["on 20", "off"]);
    assert_eq!(companion.give(10.0, 4000).await.power_mdbm, 10_000);
    assert_eq!(program.terminate(), Some(130), "{}", program.said());
    assert_eq!(program.history().last().unwrap(), "off");
}

#[test]
fn spec_a_host_that_cannot_start_has_turned_its_device_off() {
    let mut program = Program::start("refused", "");
    program.terminate();
    let logs = program.directory.join("logs");
    for (obstacle, says) in [("link", "already in use"), ("log", "[log] dir")] {
        let taken =
            (obstacle == "link").then(|| std::net::UdpSocket::bind(("127.0.0.1", program.port)).unwrap());
        if obstacle == "log" {
            std::fs::remove_dir_all(&logs).unwrap();
            std::fs::write(&logs, "no directory").unwrap();
        }
        // What a host that was killed on the air leaves.
        std::fs::write(program.directory.join("history"), "on 20\n").unwrap();
        program.again();
        assert_eq!(program.child.wait().unwrap().code(), Some(2), "{}", program.said());
        assert!(program.said().contains(says), "{}", program.said());
        assert_eq!(program.history(), ["on 20", "off"], "{}", program.said());
        drop(taken);
    }
}

#[tokio::test]
async fn spec_a_kill_outlives_the_program() {
    let mut program = Program::start("kill", "");
    let mut companion = Companion::new(program.port, 5, None).await;
    companion.report().await;
    companion.give(10.0, 4000).await;
    let kill = |param1| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            command: MavCmd::MAV_CMD_USER_2,
            target_system: if param1 == 0.0 { 0 } else { OWN.0 },
            target_component: if param1 == 0.0 { 0 } else { OWN.1 },
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    companion.say(kill(0.0));
    accepted(&mut companion).await;
    assert_eq!(program.history().last().unwrap(), "off");
    program.terminate();
    program.again();
    let mut companion = Companion::new(program.port, 6, None).await;
    companion.report().await;
    assert_eq!(companion.give(10.0, 4000).await.result, Is::VEILWING_RADIO_RESULT_NOT_NOW);
    assert!(program.said().contains("a radio kill holds"), "{}", program.said());
    while companion.report().await.power_mdbm != i32::MIN {}
    companion.say(kill(1.0));
    accepted(&mut companion).await;
    assert_eq!(companion.give(10.0, 4000).await.power_mdbm, 10_000);
}

async fn accepted(companion: &mut Companion) {
    loop {
        if let Aboard::Common(MavMessage::COMMAND_ACK(ack)) = companion.hear().await
            && ack.result == MavResult::MAV_RESULT_ACCEPTED
        {
            return;
        }
    }
}
