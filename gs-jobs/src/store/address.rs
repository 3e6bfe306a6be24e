//! The address of an object store.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

/// The address of a place in an object store: `s3://BUCKET/PREFIX`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct StoreAddress {
    bucket: String,
    /// Without `/` at either end; may be empty.
    prefix: String,
}

const SCHEME: &str = "s3://";

impl StoreAddress {
    #[cfg(feature = "object-store")]
    pub(super) fn bucket(&self) -> &str {
        &self.bucket
    }

    #[cfg(feature = "object-store")]
    pub(super) fn prefix(&self) -> &str {
        &self.prefix
    }
}

impl FromStr for StoreAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "write it as s3://BUCKET/PREFIX".to_owned();
        let path = text.strip_prefix(SCHEME).ok_or_else(wrong)?;
        let (bucket, prefix) = path.split_once('/').unwrap_or((path, ""));
        let is_bucket =
            !bucket.is_empty() && bucket.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte));
        let prefix = prefix.trim_end_matches('/');
        let is_part = |part: &str| {
            !["", ".", ".."].contains(&part) && part.chars().all(|c| c.is_alphanumeric() || "-._=+@".contains(c))
        };
        match is_bucket && (prefix.is_empty() || prefix.split('/').all(is_part)) {
            true => Ok(Self { bucket: bucket.to_owned(), prefix: prefix.to_owned() }),
            false => Err(wrong() + ", of letters, digits, `-`, `.` and `_`"),
        }
    }
}

impl TryFrom<String> for StoreAddress {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<StoreAddress> for String {
    fn from(address: StoreAddress) -> Self {
        address.to_string()
    }
}

impl fmt::Display for StoreAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bucket, prefix } = self;
        let slash = if prefix.is_empty() { "" } else { "/" };
        write!(f, "{SCHEME}{bucket}{slash}{prefix}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_a_bucket_and_a_prefix() {
        for (text, shown) in [("s3://b", "s3://b"), ("s3://b/", "s3://b"), ("s3://my.b/a/c_1/", "s3://my.b/a/c_1")] {
            let address: StoreAddress = text.parse().unwrap();
            assert_eq!(address.to_string(), shown);
            let json = serde_json::to_string(&address).unwrap();
            assert_eq!((serde_json::from_str::<StoreAddress>(&json).unwrap(), json), (address, format!("{shown:?}")));
        }
        for wrong in ["b", "gs://b/p", "s3://", "s3:///p", "s3://b/a//c", "s3://b/../c", "s3://b/a b", "s3://b?x=1"] {
            assert!(
                wrong.parse::<StoreAddress>().unwrap_err().starts_with("write it as s3://BUCKET/PREFIX"),
                "{wrong}"
            );
        }
    }
}
