//! `--max-error`: sentences of [`specula_report::certificate`] with the program's options.

use crate::failure::Failure;
use specula_report::certificate::{CertificateError, CertifiedScene};

impl From<CertificateError> for Failure {
    fn from(error: CertificateError) -> Self {
        let remedy = match error {
            CertificateError::NoReference => "leave --max-error out".to_owned(),
            CertificateError::Rounding { .. } => {
                format!("use --max-error {}", error.error_min().unwrap_or_default())
            }
            CertificateError::NotFinite { .. } => "specula info finds them, or render without --max-error".to_owned(),
            CertificateError::Failed => "look at it without --max-error".to_owned(),
        };
        Self::Input(format!("{error}; {remedy}"))
    }
}

/// Sentence on the verified pictures, which names the option that leaves them unverified.
pub(crate) fn report(certified: &CertifiedScene) -> String {
    certified.report().replace("the work of unverified pictures", "the work of --no-verify")
}
