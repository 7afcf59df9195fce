//! Software-defined radios by SoapySDR: noise at a gain. Behind the cargo feature `soapy`, which is off by default, as it needs
//! a C library (Debian's libsoapysdr-dev).
//!
//! What is radiated is complex Gaussian noise as wide as the sample rate: what a jammer is for. A transmitter that carries
//! data has a modem of its own, and is driven by that. The setting is the channel's overall gain in dB; what it gives at
//! the connector, only a calibration says, and a file without one is refused.
//!
//! Facts, of SoapySDR's own documents (Device.hpp, 0.8):
//! - Gain is distributed over the channel's elements by the driver, and read back as the driver has it; a device may round.
//! - A stream that is not active transmits nothing new. What hardware radiates without samples, between bursts and after an
//!   underrun, is the driver's and the hardware's: many leak their local oscillator. So off is all of it: gain to its least, zeros as
//!   the burst's end, and the stream deactivated, with the gain read back.
//! - `deactivateStream` and `activateStream` may take long, and may be refused with NOT_SUPPORTED by drivers that have no such
//!   thing; `writeStream` blocks until there is space, or to its timeout.
//! - Calls cannot be broken off: a driver that hangs in one hangs an off too. Only a kill line is silence then.
//!
//! When this program dies its device is closed by the kernel (USB) or forgotten (network); when it is stopped, samples run out.
//! What the hardware radiates then is to be measured, and nothing here declares it. SoapySDR's null device (`driver=null`) has
//! gains that are 0 and takes no samples: off can be tried with it, and a power is refused.

use std::fmt;

/// The device's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Which one, as `SoapySDRUtil --find` has it: `driver=lime,serial=...`.
    pub args: String,
    /// Of its transmit channels.
    pub channel: usize,
    /// Its connector; `None`: as the driver has it.
    pub antenna: Option<String>,
    /// What is radiated at.
    pub frequency_hz: f64,
    /// How wide.
    pub sample_rate_hz: f64,
    /// The gain that is off.
    pub least_gain_db: f64,
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} channel {}", self.args, self.channel)
    }
}

#[cfg(feature = "soapy")]
pub use driven::Soapy;

#[cfg(feature = "soapy")]
mod driven {
    use std::f64::consts::TAU;
    use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

    use nalgebra::Complex;
    use rand::{Rng as _, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use soapysdr::{Device as Radio, Direction::Tx, ErrorCode, TxStream};
    use tokio::sync::oneshot;

    use super::Settings;
    use crate::radio_device::{Device, DeviceError};

    /// So many samples are played over and over.
    const SAMPLES: usize = 1 << 16;
    /// Written at once: off waits for no more than these.
    const AT_ONCE: usize = 4096;
    /// Far enough below full scale that peaks are seldom cut.
    const RMS: f64 = 0.2;
    /// A write that finds no space gives up after this, in microseconds, and looks for orders.
    const SPACE_US: i64 = 20_000;
    /// Two gains that are one.
    const SAME_DB: f64 = 0.01;

    /// What the device is told.
    #[derive(Debug, Clone, Copy)]
    enum Told {
        Off,
        Gain(f64),
    }

    type Became = Result<Option<f64>, DeviceError>;

    /// See the module above. A thread of its own writes the samples.
    #[derive(Debug)]
    pub struct Soapy {
        settings: Settings,
        orders: Option<Sender<(Told, oneshot::Sender<Became>)>>,
    }

    impl Soapy {
        /// A device that is not opened yet.
        #[must_use]
        pub fn new(settings: Settings) -> Self {
            Self { settings, orders: None }
        }

        async fn tell(&mut self, told: Told) -> Became {
            let gone = || DeviceError::Unreachable(std::io::ErrorKind::BrokenPipe.into());
            let orders = match &self.orders {
                Some(orders) => orders,
                None => {
                    let (orders, taken) = channel();
                    let settings = self.settings.clone();
                    std::thread::Builder::new()
                        .name("soapy".to_owned())
                        .spawn(move || transmit(&settings, &taken))?;
                    self.orders.insert(orders)
                }
            };
            let (reply, became) = oneshot::channel();
            orders.send((told, reply)).map_err(|_| gone())?;
            became.await.unwrap_or_else(|_| Err(gone()))
        }
    }

    impl Device for Soapy {
        async fn off(&mut self) -> Result<(), DeviceError> {
            self.tell(Told::Off).await.map(|_| ())
        }

        async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
            self.tell(Told::Gain(setting)).await
        }
    }

    /// Takes orders, the newest alone, and writes samples in between while it is on. Off when nobody gives orders any more.
    fn transmit(settings: &Settings, orders: &Receiver<(Told, oneshot::Sender<Became>)>) {
        let mut open: Option<Open> = None;
        loop {
            let on = open.as_ref().is_some_and(|open| open.stream.active());
            let order = if on {
                match orders.try_recv() {
                    Ok(order) => Some(order),
                    Err(TryRecvError::Empty) => None,
                    Err(TryRecvError::Disconnected) => break,
                }
            } else {
                match orders.recv() {
                    Ok(order) => Some(order),
                    Err(_) => break,
                }
            };
            let Some((told, reply)) = order.map(|order| orders.try_iter().last().unwrap_or(order)) else {
                if let Some(radio) = &mut open
                    && let Err(error) = radio.write()
                {
                    tracing::warn!(%settings, %error, "samples are not taken: off");
                    let _ = radio.off();
                    open = None;
                }
                continue;
            };
            let became = carry_out(&mut open, settings, told);
            if became.is_err() {
                // Opened anew by the next order; closing it ends its stream.
                if let Some(mut radio) = open.take() {
                    let _ = radio.off();
                }
            }
            // Whoever gave it may have given another one since.
            let _ = reply.send(became);
        }
        if let Some(mut radio) = open {
            let _ = radio.off();
        }
    }

    fn carry_out(open: &mut Option<Open>, settings: &Settings, told: Told) -> Became {
        let radio = match open {
            Some(radio) => radio,
            None => open.insert(Open::new(settings).map_err(|error| fault(&error))?),
        };
        match told {
            Told::Off => radio.off().map(|()| None),
            Told::Gain(gain) => radio.set(gain).map(Some),
        }
    }

    fn fault(error: &soapysdr::Error) -> DeviceError {
        match error.code {
            ErrorCode::NotSupported => DeviceError::refused(&error.to_string()),
            _ => DeviceError::Unreachable(std::io::Error::other(error.to_string())),
        }
    }

    /// A device that is open; at its least gain until it is told otherwise.
    struct Open {
        radio: Radio,
        stream: TxStream<Complex<f32>>,
        channel: usize,
        least_gain_db: f64,
        noise: Vec<Complex<f32>>,
        at: usize,
    }

    impl Open {
        fn new(settings: &Settings) -> Result<Self, soapysdr::Error> {
            let Settings { channel, least_gain_db, .. } = *settings;
            let radio = Radio::new(settings.args.as_str())?;
            radio.set_gain(Tx, channel, least_gain_db)?;
            radio.set_sample_rate(Tx, channel, settings.sample_rate_hz)?;
            radio.set_frequency(Tx, channel, settings.frequency_hz, ())?;
            if let Some(antenna) = &settings.antenna {
                radio.set_antenna(Tx, channel, antenna.as_str())?;
            }
            let stream = radio.tx_stream(&[channel])?;
            Ok(Self { radio, stream, channel, least_gain_db, noise: noise(), at: 0 })
        }

        fn gain(&self) -> Result<f64, DeviceError> {
            self.radio.gain(Tx, self.channel).map_err(|error| fault(&error))
        }

        /// All of it, whatever fails; the first failure is said.
        fn off(&mut self) -> Result<(), DeviceError> {
            let least = self.radio.set_gain(Tx, self.channel, self.least_gain_db);
            let ended = if self.stream.active() {
                // A burst's end that finds no space is ended by what follows.
                let zeros = [Complex::new(0.0, 0.0); AT_ONCE];
                let _ = self.stream.write(&[&zeros], None, true, SPACE_US);
                self.stream.deactivate(None)
            } else {
                Ok(())
            };
            least.and(ended).map_err(|error| fault(&error))?;
            let gain = self.gain()?;
            if gain <= self.least_gain_db + SAME_DB {
                Ok(())
            } else {
                Err(DeviceError::StillOn(format!("a gain of {gain} dB")))
            }
        }

        fn set(&mut self, gain_db: f64) -> Result<f64, DeviceError> {
            self.radio.set_gain(Tx, self.channel, gain_db).map_err(|error| fault(&error))?;
            if !self.stream.active() {
                self.stream.activate(None).map_err(|error| fault(&error))?;
            }
            self.write().map_err(|error| fault(&error))?;
            self.gain()
        }

        /// Some samples more. No space, or too few in time before, is no failure.
        fn write(&mut self) -> Result<(), soapysdr::Error> {
            let to = (self.at + AT_ONCE).min(self.noise.len());
            match self.stream.write(&[&self.noise[self.at..to]], None, false, SPACE_US) {
                Ok(written) => {
                    self.at = (self.at + written) % self.noise.len();
                    Ok(())
                }
                Err(error) if matches!(error.code, ErrorCode::Timeout | ErrorCode::Underflow) => Ok(()),
                Err(error) => Err(error),
            }
        }
    }

    /// Complex Gaussian noise, cut at full scale.
    fn noise() -> Vec<Complex<f32>> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let one = |()| {
            let radius = RMS * libm::sqrt(-libm::log(1.0 - uniform())).min(1.0 / RMS);
            let angle = TAU * uniform();
            Complex::new((radius * libm::cos(angle)) as f32, (radius * libm::sin(angle)) as f32)
        };
        std::iter::repeat_n((), SAMPLES).map(one).collect()
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn val_noise_has_its_power_no_mean_and_stays_within_full_scale() {
            let noise = noise();
            let power: f64 = noise.iter().map(|s| f64::from(s.norm_sqr())).sum::<f64>() / noise.len() as f64;
            assert!((power - RMS * RMS).abs() < 0.02 * RMS * RMS, "{power}");
            let mean: Complex<f64> =
                noise.iter().map(|s| Complex::new(f64::from(s.re), f64::from(s.im))).sum::<Complex<f64>>()
                    / noise.len() as f64;
            assert!(mean.norm() < 0.02 * RMS, "{mean}");
            assert!(noise.iter().all(|s| s.norm() <= 1.0));
        }

        fn null(args: &str) -> Soapy {
            Soapy::new(Settings {
                args: args.to_owned(),
                channel: 0,
                antenna: None,
                frequency_hz: 2.4e9,
                sample_rate_hz: 1e6,
                least_gain_db: 0.0,
            })
        }

        /// SoapySDR's own null device takes every setting, has a gain of 0, and takes no samples.
        #[tokio::test]
        async fn spec_the_null_device_is_off_and_a_power_that_it_does_not_take_is_refused_and_off_again() {
            let mut device = null("driver=null");
            device.off().await.unwrap();
            let error = device.set(20.0).await.unwrap_err();
            assert_eq!(error.fault(), crate::radio_host::Fault::Refused, "{error}");
            device.off().await.unwrap();
        }

        #[tokio::test]
        async fn spec_a_device_that_is_not_there_cannot_be_reached() {
            let mut device = null("driver=no_such_driver");
            assert_eq!(device.off().await.unwrap_err().fault(), crate::radio_host::Fault::Unreachable);
        }
    }
}
