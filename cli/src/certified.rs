//! `--max-error`: sentences of [`specula_report::certificate`] with the program's options.

use crate::failure::Failure;
use specula_report::certificate::{CertificateError, CertifiedScene};

impl From<CertificateError> for Failure {
    fn from(error: CertificateError) -> Self {
        let remedy = match error {
            CertificateError::NoReference => "omit --max-error".to_owned(),
            CertificateError::Rounding { .. } => {
                format!("use --max-error {}", error.error_min().unwrap_or_default())
            }
            CertificateError::NotFinite { .. } => "specula info finds them, or render without --max-error".to_owned(),
            CertificateError::Failed => "render it without --max-error".to_owned(),
        };
        Self::Input(format!("{error}; {remedy}"))
    }
}

/// Sentence on the verified pictures, with the option that skips the verification.
pub(crate) fn report(certified: &CertifiedScene) -> String {
    with_option(&certified.report())
}

fn with_option(sentence: &str) -> String {
    sentence.replace("the work of unverified pictures", "the work of --no-verify")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_name_the_options() {
        let sentence = with_option("verified 9 pictures; 3.50 times the work of unverified pictures");
        assert!(sentence.ends_with("3.50 times the work of --no-verify"), "{sentence}");
        let refused = Failure::from(CertificateError::Rounding { asked: 1e-4, rounding: 2.31e-4 });
        assert!(refused.to_string().ends_with("; use --max-error 3e-4"), "{refused}");
    }
}
