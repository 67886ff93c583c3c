//! Structs that Rust and WGSL share: declared once in Rust, described for the test that compares them with WGSL.
//!
//! In: struct declarations inside `gpu_types!`; out: the same structs, `repr(C)` and Pod, and a `MIRRORS` list of
//! names, types and offsets. `tests/shader_layout.rs` holds every list against `shaders/lib/types.wgsl`, field by
//! field. Costs nothing at run time.

/// One field of a mirrored struct: name, Rust type as written, byte offset.
pub type Field = (&'static str, &'static str, usize);

/// What the layout test needs to know about a mirrored struct.
#[derive(Clone, Copy, Debug)]
pub struct Mirror {
    /// Name of the struct in WGSL.
    pub wgsl_name: &'static str,
    /// `size_of` in Rust.
    pub size: usize,
    /// In order of declaration.
    pub fields: &'static [Field],
}

/// Declares structs that mirror `shaders/lib/types.wgsl`, and `MIRRORS`, the list of them. Once per module.
///
/// `struct GpuTree as "Tree" { .. }` mirrors WGSL's `Tree`. The structs get `repr(C)`, `Clone`, `Copy`, `Debug`, `Pod` and
/// `Zeroable`; other derives may be written on them. Padding is not allowed (Pod rejects it): write it as a field, in
/// WGSL too. Types are spelt as the test spells WGSL's: `f32`, `u32`, `i32`, `[f32; 3]` for `vec3<f32>` (12 bytes, aligned to
/// 16 in WGSL), `[[f32; 4]; 4]` for `mat4x4<f32>`.
///
/// Add the module's `MIRRORS` to `bevy_treeline::MIRRORS` in `lib.rs`, else the test cannot see it.
macro_rules! gpu_types {
    ($($(#[$meta:meta])* $vis:vis struct $name:ident as $wgsl:literal {
        $($(#[$field_meta:meta])* $field_vis:vis $field:ident : $ty:ty),* $(,)?
    })*) => {
        $(
            $(#[$meta])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
            $vis struct $name { $($(#[$field_meta])* $field_vis $field: $ty),* }
        )*

        /// Every mirrored struct of this module.
        pub const MIRRORS: &[$crate::gpu::mirror::Mirror] = &[$($crate::gpu::mirror::Mirror {
            wgsl_name: $wgsl,
            size: size_of::<$name>(),
            fields: &[$((stringify!($field), stringify!($ty), core::mem::offset_of!($name, $field))),*],
        }),*];
    };
}

pub(crate) use gpu_types;

#[cfg(test)]
mod tests {
    mod declared {
        super::super::gpu_types! {
            /// One tree.
            #[derive(PartialEq)]
            pub struct GpuTree as "Tree" {
                /// World space.
                pub position: [f32; 3],
                pub seed: u32,
            }
            pub struct GpuCounter as "Counter" { pub value: u32 }
        }
    }

    #[test]
    fn a_mirror_names_every_field_with_type_and_offset() {
        let [tree, counter] = declared::MIRRORS else { panic!("two structs are declared") };
        assert_eq!((tree.wgsl_name, tree.size), ("Tree", 16));
        assert_eq!(tree.fields, [("position", "[f32; 3]", 0), ("seed", "u32", 12)]);
        assert_eq!((counter.wgsl_name, counter.size), ("Counter", 4));
        let tree = declared::GpuTree { position: [1.0, 2.0, 3.0], seed: 4 };
        assert_eq!(bytemuck::bytes_of(&tree).len(), 16);
        assert_eq!(bytemuck::bytes_of(&declared::GpuCounter { value: 7 }), 7u32.to_ne_bytes());
    }
}
