//! Elementary functions missing in `core`, from `std` or `libm`; no other module depends on the
//! choice.

macro_rules! forward {
    ($($(#[$doc:meta])* $name:ident($($arg:ident),*) = $f32_method:ident, $libm32:ident; f64: $name64:ident, $libm64:ident;)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name($($arg: f32),*) -> f32 {
            #[cfg(feature = "std")]
            return f32::$f32_method($($arg),*);
            #[cfg(not(feature = "std"))]
            return libm::$libm32($($arg),*);
        }
        $(#[$doc])*
        #[inline(always)]
        pub fn $name64($($arg: f64),*) -> f64 {
            #[cfg(feature = "std")]
            return f64::$f32_method($($arg),*);
            #[cfg(not(feature = "std"))]
            return libm::$libm64($($arg),*);
        }
    )*};
}

forward! {
    /// Square root.
    sqrt(x) = sqrt, sqrtf; f64: sqrt64, sqrt;
    /// Largest whole number not above `x`.
    floor(x) = floor, floorf; f64: floor64, floor;
    /// Angle of the point (x, y), in (−π, π].
    atan2(y, x) = atan2, atan2f; f64: atan264, atan2;
    /// Inverse tangent.
    atan(x) = atan, atanf; f64: atan64, atan;
    /// Inverse cosine, for arguments in \[−1, 1\].
    acos(x) = acos, acosf; f64: acos64, acos;
    /// Sine of an angle in radians.
    sin(x) = sin, sinf; f64: sin64, sin;
    /// Cosine of an angle in radians.
    cos(x) = cos, cosf; f64: cos64, cos;
    /// Tangent of an angle in radians.
    tan(x) = tan, tanf; f64: tan64, tan;
    /// Power of e.
    exp(x) = exp, expf; f64: exp64, exp;
    /// Natural logarithm.
    ln(x) = ln, logf; f64: ln64, log;
    /// Power of two.
    exp2(x) = exp2, exp2f; f64: exp264, exp2;
    /// Logarithm to base two.
    log2(x) = log2, log2f; f64: log264, log2;
    /// `x` to the power `y`.
    pow(x, y) = powf, powf; f64: pow64, pow;
}
