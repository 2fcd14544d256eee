//! Uniform structures: one declaration is the structure of the host and that of the kernels.

use crate::codegen::source::Source;
use bytemuck::Pod;
use core::fmt::Write;

/// Declares a uniform structure of the host, and makes it a [`UniformStruct`]. A structure that
/// WGSL would lay out in another way does not compile.
macro_rules! uniform {
    ($(#[$meta:meta])* $visibility:vis struct $name:ident {
        $($(#[$field_meta:meta])* $field_visibility:vis $field:ident: $kind:ty,)+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, ::bytemuck::Pod, ::bytemuck::Zeroable)]
        #[repr(C)]
        $visibility struct $name {
            $($(#[$field_meta])* $field_visibility $field: $kind,)+
        }

        impl $crate::codegen::uniform::UniformStruct for $name {
            const NAME: &'static str = stringify!($name);
            const FIELDS: &'static [$crate::codegen::uniform::UniformField] = &[
                $($crate::codegen::uniform::UniformField::new::<$kind>(
                    stringify!($field),
                    ::core::mem::offset_of!($name, $field),
                ),)+
            ];
        }

        const _: () = $crate::codegen::uniform::assert_layout::<$name>();

        impl $name {
            /// Bytes of the uniform.
            $visibility fn bytes(&self) -> $crate::codegen::uniform::UniformBytes<'_> {
                $crate::codegen::uniform::UniformBytes::new(self)
            }
        }
    };
}
pub(crate) use uniform;

/// Structure with the same layout on the host and in WGSL.
pub(crate) trait UniformStruct: Pod {
    /// Name on the host. In WGSL it has no final `Uniform`.
    const NAME: &'static str;
    /// Fields, in the order of their offsets.
    const FIELDS: &'static [UniformField];

    /// Declaration in WGSL.
    fn declaration() -> String {
        let mut text = format!("struct {} {{\n", Self::NAME.trim_end_matches("Uniform"));
        for UniformField { name, wgsl, .. } in Self::FIELDS {
            writeln!(text, "    {name}: {wgsl},").expect("strings take everything");
        }
        text + "}\n"
    }
}

/// Type of a uniform's field.
pub(crate) trait UniformType {
    /// Type in WGSL.
    const WGSL: &'static str;
    /// Alignment in WGSL, in bytes.
    const ALIGNMENT: usize;
}

macro_rules! uniform_types {
    ($($host:ty = $wgsl:literal, $alignment:literal;)+) => {$(
        impl UniformType for $host {
            const WGSL: &'static str = $wgsl;
            const ALIGNMENT: usize = $alignment;
        }
    )+};
}

// WGSL, section "Alignment and Size".
uniform_types! {
    u32 = "u32", 4;
    f32 = "f32", 4;
    [u32; 2] = "vec2u", 8;
    [f32; 2] = "vec2f", 8;
    [f32; 3] = "vec3f", 16;
    [f32; 4] = "vec4f", 16;
}

/// Field of a uniform structure.
#[derive(Clone, Copy, Debug)]
pub(crate) struct UniformField {
    name: &'static str,
    wgsl: &'static str,
    alignment: usize,
    /// Bytes in front of the field on the host, and bytes of the field.
    offset: usize,
    size: usize,
}

impl UniformField {
    pub(crate) const fn new<T: UniformType>(name: &'static str, offset: usize) -> Self {
        Self { name, wgsl: T::WGSL, alignment: T::ALIGNMENT, offset, size: size_of::<T>() }
    }
}

/// Panics, while the executor is compiled, unless WGSL's layout is that of the host.
pub(crate) const fn assert_layout<T: UniformStruct>() {
    if let Some(fault) = layout_fault(T::FIELDS, size_of::<T>()) {
        panic!("{}", fault);
    }
}

/// Difference between WGSL's layout and that of the host, where fields have these offsets in a
/// structure of this size.
const fn layout_fault(fields: &[UniformField], size: usize) -> Option<&'static str> {
    let (mut end, mut alignment, mut k) = (0_usize, 1, 0);
    while k < fields.len() {
        let field = fields[k];
        if end.next_multiple_of(field.alignment) != field.offset {
            return Some("WGSL aligns a field of this uniform: declare padding in front of it");
        }
        end = field.offset + field.size;
        if field.alignment > alignment {
            alignment = field.alignment;
        }
        k += 1;
    }
    if end.next_multiple_of(alignment) == size {
        None
    } else {
        Some("WGSL pads this uniform: declare padding at its end")
    }
}

/// Bytes of a [`UniformStruct`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct UniformBytes<'a>(&'a [u8]);

impl<'a> UniformBytes<'a> {
    pub(crate) fn new<T: UniformStruct>(uniform: &'a T) -> Self {
        Self(bytemuck::bytes_of(uniform))
    }
    pub(crate) fn as_slice(self) -> &'a [u8] {
        self.0
    }
}

uniform! {
    /// Number of elements that a kernel processes.
    pub(crate) struct Count {
        count: u32,
    }
}

impl Count {
    pub(crate) fn new(count: usize) -> Self {
        Self { count: count as u32 }
    }
}

impl Source {
    /// Appends the declaration of a uniform structure.
    pub(crate) fn uniform<T: UniformStruct>(self) -> Self {
        self.with(&T::declaration())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use wgpu::naga::{TypeInner, front::wgsl};

    uniform! {
        /// Fields of every type, in front of and behind narrower ones.
        struct EveryTypeUniform {
            a: [f32; 3],
            b: u32,
            c: [f32; 2],
            d: [u32; 2],
            e: f32,
            padding_e: u32,
            f: [u32; 2],
            g: [f32; 4],
            h: [f32; 3],
            padding_end: u32,
        }
    }

    /// Name, offset and size of each member, and the size of the structure, by WGSL's compiler.
    fn reflected(declaration: &str, name: &str) -> (Vec<(String, usize, usize)>, usize) {
        let module = wgsl::parse_str(declaration).expect("a declaration is WGSL");
        let (_, found) = module.types.iter().find(|(_, found)| found.name.as_deref() == Some(name)).expect("its name");
        let TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no structure") };
        let size = |member: &wgpu::naga::StructMember| module.types[member.ty].inner.size(module.to_ctx()) as usize;
        let members = members
            .iter()
            .map(|member| (member.name.clone().unwrap_or_default(), member.offset as usize, size(member)))
            .collect();
        (members, *span as usize)
    }

    #[test]
    fn structures_have_the_layout_of_wgsl() {
        let (members, size) = reflected(&EveryTypeUniform::declaration(), "EveryType");
        let fields: Vec<_> =
            EveryTypeUniform::FIELDS.iter().map(|field| (field.name.to_owned(), field.offset, field.size)).collect();
        assert_eq!((members, size), (fields, size_of::<EveryTypeUniform>()));
        assert_eq!(EveryTypeUniform::zeroed().bytes().as_slice().len(), size);
    }

    #[test]
    fn a_layout_without_the_padding_of_wgsl_is_found() {
        let number = UniformField::new::<f32>("number", 0);
        let after = UniformField::new::<[f32; 3]>("after", 4);
        let aligned = UniformField::new::<[f32; 3]>("after", 16);
        assert_eq!(layout_fault(&[number, aligned], 32), None);
        assert!(layout_fault(&[number, after], 16).is_some_and(|fault| fault.contains("in front")));
        assert!(layout_fault(&[number, aligned], 28).is_some_and(|fault| fault.contains("at its end")));
    }
}
