//! The secret key.

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use mavlink::{MAVLinkV2MessageRaw, consts};

use super::SigningError;

const KEY_BYTES: usize = 32;
/// More than any key file has.
const FILE_BYTES_MAX: u64 = 1024;

/// A signing key. Its debug output does not show it.
#[derive(Clone, PartialEq, Eq)]
pub struct Key([u8; KEY_BYTES]);

impl Key {
    /// A key from its bytes.
    #[must_use]
    pub const fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(bytes)
    }

    /// Reads a key file: 64 hexadecimal digits, with or without a line end, or 32 bytes as they are.
    ///
    /// # Errors
    /// If the file cannot be read, is open to others than its owner, or holds no key. The key 0 is none:
    /// to MAVLink it means that signing is off.
    pub fn load(path: &Path) -> Result<Self, SigningError> {
        let failed = |source: io::Error| SigningError::KeyFile { path: path.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = file.metadata().map_err(failed)?.permissions().mode() & 0o777;
            if mode & 0o077 != 0 {
                return Err(SigningError::KeyFileMode { path: path.to_owned(), mode });
            }
        }
        let mut content = Vec::new();
        file.take(FILE_BYTES_MAX).read_to_end(&mut content).map_err(failed)?;
        let key = from_hex(content.trim_ascii()).or_else(|| content.as_slice().try_into().ok());
        key.filter(|bytes| *bytes != [0; KEY_BYTES])
            .map(Self)
            .ok_or_else(|| SigningError::KeyFileContent { path: path.to_owned(), bytes: content.len() })
    }

    /// The frame's signature with this key.
    pub(super) fn signature(&self, raw: &MAVLinkV2MessageRaw) -> [u8; consts::v2::SIGNATURE_VALUE_SIZE] {
        let mut signature = [0; consts::v2::SIGNATURE_VALUE_SIZE];
        raw.calculate_signature(&self.0, &mut signature);
        signature
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

fn from_hex(digits: &[u8]) -> Option<[u8; KEY_BYTES]> {
    if digits.len() != 2 * KEY_BYTES {
        return None;
    }
    let mut bytes = [0; KEY_BYTES];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        let high = char::from(pair[0]).to_digit(16)?;
        let low = char::from(pair[1]).to_digit(16)?;
        *byte = u8::try_from(16 * high + low).ok()?;
    }
    Some(bytes)
}
