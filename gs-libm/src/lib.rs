//! Gives a program `exp`, `sin` and the like with the same bits on Linux and Windows.
//!
//! C libraries round these functions differently, and glibc's results depend on the processor. The
//! standard library calls them by their names in C. This crate defines these names with the functions of the
//! crate [`libm`], and the linker prefers a program's own definitions to those of a C library. The crate
//! has nothing to call: `use gs_libm as _;` in a program is enough.
//!
//! It is empty for macOS and for Windows' MSVC targets, where the compiler calls some of these functions by
//! other names, and for WebAssembly, where the standard library contains [`libm`].

#![cfg(any(target_os = "linux", all(windows, target_env = "gnu")))]

/// Defines functions of C by those of [`libm`] with the same name.
macro_rules! define {
    ($type:ty: $($name:ident($($x:ident),+))*) => {
        $(
            // SAFETY: a definition of the function that has this name in C, with its signature and meaning.
            #[expect(unsafe_code, reason = "the names are those of C")]
            #[unsafe(no_mangle)]
            extern "C" fn $name($($x: $type),+) -> $type {
                libm::$name($($x),+)
            }
        )*
    };
}

define! { f64:
    acos(x) asin(x) atan(x) atan2(y, x) cbrt(x) cos(x) cosh(x) exp(x) exp2(x) expm1(x) hypot(x, y)
    log(x) log10(x) log1p(x) log2(x) pow(x, y) sin(x) sinh(x) tan(x) tanh(x)
}

define! { f32:
    acosf(x) asinf(x) atanf(x) atan2f(y, x) cbrtf(x) cosf(x) coshf(x) expf(x) exp2f(x) expm1f(x) hypotf(x, y)
    logf(x) log10f(x) log1pf(x) log2f(x) powf(x, y) sinf(x) sinhf(x) tanf(x) tanhf(x)
}

/// Defines the function of glibc and of MinGW by which the compiler replaces a sine and a cosine of one angle.
macro_rules! define_both {
    ($name:ident, $type:ty) => {
        // SAFETY: as above; callers give places for both results.
        #[expect(unsafe_code, reason = "the name and the pointers are those of C")]
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $name(x: $type, sin: *mut $type, cos: *mut $type) {
            unsafe { (*sin, *cos) = libm::$name(x) }
        }
    };
}

define_both!(sincos, f64);
define_both!(sincosf, f32);

/// Defines the function by which the compiler replaces an integer power. On Windows it calls that of real powers.
macro_rules! define_integer_power {
    ($name:ident, $type:ty, $power:ident) => {
        // SAFETY: as above, for a function of compiler runtimes.
        #[expect(unsafe_code, reason = "the name is that of compiler runtimes")]
        #[unsafe(no_mangle)]
        extern "C" fn $name(x: $type, exponent: i32) -> $type {
            libm::$power(x, exponent as $type)
        }
    };
}

define_integer_power!(__powidf2, f64, pow);
define_integer_power!(__powisf2, f32, powf);

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    /// Bits of glibc 2.36 differ from those of [`libm`] at some of these places.
    #[test]
    fn the_standard_library_calls_these_functions() {
        for x in (1..2000).map(|i| 0.01 * f64::from(black_box(i))) {
            let single = x as f32;
            for (name, std, own) in [
                ("exp", x.exp(), libm::exp(x)),
                ("ln", x.ln(), libm::log(x)),
                ("sin", x.sin(), libm::sin(x)),
                ("sin_cos", x.sin_cos().1, libm::cos(x)),
                ("powf", x.powf(0.37), libm::pow(x, 0.37)),
                ("atan2", x.atan2(0.7), libm::atan2(x, 0.7)),
                ("powi", x.powi(black_box(7)), libm::pow(x, 7.0)),
                ("f32 powi", single.powi(black_box(7)).into(), libm::powf(single, 7.0).into()),
                ("ln_1p", x.ln_1p(), libm::log1p(x)),
                ("f32 exp", single.exp().into(), libm::expf(single).into()),
                ("f32 sin_cos", single.sin_cos().0.into(), libm::sinf(single).into()),
                ("f32 tan", single.tan().into(), libm::tanf(single).into()),
                ("f32 hypot", single.hypot(0.7).into(), libm::hypotf(single, 0.7).into()),
            ] {
                assert_eq!(std.to_bits(), own.to_bits(), "{name}({x})");
            }
        }
    }
}
