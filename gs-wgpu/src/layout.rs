//! The structs that host and shaders share. `shaders/shared.wgsl` declares them, too, and a test
//! compares every offset with naga's.

use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};
use gs_core::{CameraGradient, Culled, Error, RenderSettings};

use crate::fault::backend_error;

/// Offset of dispatch sizes in `indirect`, bytes: one invocation per Gaussian.
pub(crate) const BY_GAUSSIAN: u64 = 0;
/// Offset of dispatch sizes in `indirect`, bytes: one work group per block of the sort.
pub(crate) const BY_SORT_BLOCK: u64 = 12;
/// Offset of dispatch sizes in `indirect`, bytes: one work group per block of histograms.
pub(crate) const BY_HISTOGRAM: u64 = 24;
/// Offset of dispatch sizes in `indirect`, bytes: one invocation per SH coefficient.
pub(crate) const BY_COEFFICIENT: u64 = 36;

/// A 2D Gaussian's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Gaussian {
    pub(crate) mean: [f32; 2],
    pub(crate) opacity_logit: f32,
    /// Number of Adam steps.
    pub(crate) steps: u32,
    /// `ScaleRotation`: ln-scales and rotation. `CovarianceFactor`: the columns of L.
    pub(crate) shape: [f32; 4],
    pub(crate) color: [f32; 3],
    pub(crate) unused: f32,
}

/// A 2D Gaussian's Adam moments: of mean 2, shape 3, colour 3; then of the opacity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Moments {
    pub(crate) first: [f32; 8],
    pub(crate) second: [f32; 8],
    pub(crate) opacity: [f32; 4],
}

/// A Gaussian's density statistics.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Statistics {
    pub(crate) signal_sum: f32,
    pub(crate) visible: u32,
}

/// A 2D Gaussian's gradient in its whitened coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Gradient {
    pub(crate) color: [f32; 3],
    pub(crate) opacity_logit: f32,
    pub(crate) eta: [f32; 3],
    pub(crate) device_norm: f32,
    pub(crate) xi: [f32; 2],
    pub(crate) visible: u32,
    /// Weight of `device_norm` in the statistic.
    pub(crate) weight: u32,
}

/// A 3D Gaussian's parameters without its colour.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Ellipsoid {
    pub(crate) mean: [f32; 3],
    pub(crate) opacity_logit: f32,
    pub(crate) log_scale: [f32; 3],
    /// Number of Adam steps.
    pub(crate) steps: u32,
    /// (w, x, y, z).
    pub(crate) rotation: [f32; 4],
}

/// A 3D Gaussian's gradient without that of its colour.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct EllipsoidGradient {
    pub(crate) mean: [f32; 3],
    pub(crate) opacity_logit: f32,
    pub(crate) log_scale: [f32; 3],
    pub(crate) device_norm: f32,
    pub(crate) rotation: [f32; 4],
    /// 1 where some tile lists it. Otherwise all is 0, and its colour's gradient is unspecified.
    pub(crate) visible: u32,
    /// Weight of `device_norm` in the statistic.
    pub(crate) weight: u32,
    pub(crate) unused: [u32; 2],
}

/// A 3D Gaussian's Adam moments without its colour's: mean 3, opacity; log-scale 3, unused;
/// rotation 4.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct EllipsoidMoments {
    pub(crate) first: [f32; 12],
    pub(crate) second: [f32; 12],
}

/// The camera of a 3D scene.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Camera {
    /// Rows of W, each with its component of t.
    pub(crate) world_to_camera: [[f32; 4]; 3],
    pub(crate) position: [f32; 3],
    pub(crate) near: f32,
    pub(crate) focal: [f32; 2],
    pub(crate) center: [f32; 2],
    pub(crate) least_slope: [f32; 2],
    pub(crate) most_slope: [f32; 2],
    pub(crate) dilation: f32,
    pub(crate) compensates: u32,
    /// Depth from which gradients count fully in a statistic weighted by depth; 0 if all do.
    pub(crate) full_depth: f32,
    pub(crate) unused: u32,
}

/// The result that the host reads after a pass.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Status {
    /// Number of entries in all tiles' lists.
    pub(crate) entries: u32,
    /// Number of entries if they exceed the capacity; else 0.
    pub(crate) overflow: u32,
    /// Length of the longest list if the adapter cannot loop over it; else 0. If it is not 0,
    /// neither is `overflow`.
    pub(crate) longest: u32,
    pub(crate) loss: f32,
    /// The gradient by the camera, if it was asked for, as by [`gs_core::CameraGradient::to_array`].
    pub(crate) by_camera: [f32; 10],
    pub(crate) near: u32,
    pub(crate) not_finite: u32,
    pub(crate) degenerate: u32,
    pub(crate) transparent: u32,
    /// Number of pixels that could not sort their Gaussians.
    pub(crate) unfinished: u32,
    pub(crate) outside: u32,
}

impl Status {
    /// Number of Gaussians that projection left out, by cause.
    pub(crate) fn culled(&self) -> Culled {
        let Self { not_finite, near, degenerate, transparent, outside, .. } = *self;
        Culled { not_finite, near, degenerate, transparent, outside }
    }

    /// The gradient by the camera of a pass with these settings, if they ask for it.
    pub(crate) fn camera_gradient(&self, settings: &RenderSettings) -> Option<CameraGradient> {
        settings.camera_gradient.then(|| CameraGradient::from_array(self.by_camera))
    }

    /// Offset of the counts, bytes.
    pub(crate) const COUNTS: u64 = offset_of!(Self, near) as u64;

    /// Bytes of the counts that every pass resets: without new lists, and with them.
    pub(crate) const COUNTS_BYTES: [u64; 2] =
        [offset_of!(Self, outside) as u64 - Self::COUNTS, size_of::<Self>() as u64 - Self::COUNTS];

    /// Fails if pixels stayed unfinished.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if self.unfinished == 0 {
            return Ok(());
        }
        let pixels = self.unfinished;
        Err(backend_error(format!(
            "{pixels} pixels have more Gaussians than the backend can sort: use the global depth sort, fewer or smaller \
             Gaussians, or the CPU backend"
        )))
    }
}

/// The source of a slot of edited arrays; [`Source::NONE`] leaves zeros.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Source {
    pub(crate) parameters: u32,
    pub(crate) moments: u32,
    pub(crate) steps: u32,
    pub(crate) statistics: u32,
    pub(crate) is_fresh: u32,
}

impl Source {
    pub(crate) const NONE: u32 = u32::MAX;
}

/// The uniform of a pass: the only data that the host sends in a training step.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Step {
    pub(crate) origin: [f32; 2],
    pub(crate) pixels_per_unit: [f32; 2],
    pub(crate) size: [u32; 2],
    pub(crate) tiles: [u32; 2],
    pub(crate) background: [f32; 3],
    pub(crate) gaussians: u32,
    pub(crate) alpha_cut: f32,
    pub(crate) alpha_max: f32,
    pub(crate) transmittance_min: f32,
    pub(crate) entry_capacity: u32,
    pub(crate) pointwise_scale: f32,
    pub(crate) dssim_scale: f32,
    pub(crate) per_value: f32,
    pub(crate) epsilon: f32,
    pub(crate) min_scale: f32,
    pub(crate) max_scale: f32,
    pub(crate) opaque: u32,
    pub(crate) collect: u32,
    pub(crate) visible_only: u32,
    /// SH coefficients of a Gaussian; 0 in 2D scenes.
    pub(crate) coefficients: u32,
    pub(crate) sh_degree: u32,
    pub(crate) depth_bits: u32,
    pub(crate) longest_list: u32,
    pub(crate) dilation: f32,
    pub(crate) compensates: u32,
    /// What 3D Gaussians show: 0 for colours, 1 for inverse depths, 2 for alpha.
    pub(crate) output: u32,
    /// The share of 3D Gaussians that is left out, times 2²⁴, and the seed that selects them.
    pub(crate) dropout_threshold: u32,
    pub(crate) dropout_seed: u32,
    /// The first Gaussians, which do not change.
    pub(crate) fixed: u32,
    /// Aligns the rates to 16 bytes, as WGSL does with vectors.
    pub(crate) padding: u32,
    /// Rates per group: learning rate, β₁, β₂, 1 − β₁.
    pub(crate) rates: [[f32; 4]; 6],
    /// Decays per group: ln β₁, ln β₂, 1 − β₂, and for scales and opacities the penalty's weight
    /// per number.
    pub(crate) decays: [[f32; 4]; 6],
}

/// The uniform for noise on the means.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Noise {
    pub(crate) scale: f32,
    pub(crate) seed: u32,
    pub(crate) step: u32,
    pub(crate) gaussians: u32,
    /// The first Gaussians, which do not move.
    pub(crate) fixed: u32,
}

/// The uniform of `show.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Shown {
    pub(crate) width: u32,
    pub(crate) encodes: u32,
    pub(crate) unused: [u32; 2],
}

/// Bytes of one of `solve_colors.wgsl`'s `Conjugate`, and of its `Scalars`.
pub(crate) const CONJUGATE_BYTES: u64 = 64;

/// Bytes of `Splat`.
pub(crate) const SPLAT_BYTES: u64 = 48;

/// Bytes of `Queued`.
pub(crate) const QUEUED_BYTES: u64 = 64;

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::{
        collect::Collected,
        shaders::{Kernels, Pass, SHADERS, Variant},
    };

    fn module(text: &str) -> naga::Module {
        naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)))
    }

    /// Offsets and span of a struct in the shaders.
    fn in_shader(module: &naga::Module, name: &str) -> (Vec<(String, u32)>, u32) {
        let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
        let (_, found) = found.unwrap_or_else(|| panic!("no struct {name}"));
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
    }

    macro_rules! same_layout {
        ($module:expr, $name:ident { $($field:ident),* $(,)? }) => {
            let expected = vec![$((stringify!($field).to_owned(), offset_of!($name, $field) as u32)),*];
            assert_eq!(in_shader($module, stringify!($name)), (expected, size_of::<$name>() as u32), stringify!($name));
        };
    }

    fn shader(name: &str) -> &'static crate::shaders::Shader {
        SHADERS.iter().find(|s| s.name == name).unwrap()
    }

    #[test]
    fn host_and_shaders_agree_on_every_struct() {
        let m = &module(&shader("edit").text(Variant::default()));
        same_layout!(m, Gaussian { mean, opacity_logit, steps, shape, color, unused });
        same_layout!(m, Moments { first, second, opacity });
        same_layout!(m, Statistics { signal_sum, visible });
        same_layout!(m, Gradient { color, opacity_logit, eta, device_norm, xi, visible, weight });
        same_layout!(m, Ellipsoid { mean, opacity_logit, log_scale, steps, rotation });
        same_layout!(m, EllipsoidMoments { first, second });
        same_layout!(
            m,
            EllipsoidGradient { mean, opacity_logit, log_scale, device_norm, rotation, visible, weight, unused }
        );
        same_layout!(m, Source { parameters, moments, steps, statistics, is_fresh });
        same_layout!(
            m,
            Status {
                entries,
                overflow,
                longest,
                loss,
                by_camera,
                near,
                not_finite,
                degenerate,
                transparent,
                unfinished,
                outside
            }
        );
        same_layout!(
            m,
            Step {
                origin,
                pixels_per_unit,
                size,
                tiles,
                background,
                gaussians,
                alpha_cut,
                alpha_max,
                transmittance_min,
                entry_capacity,
                pointwise_scale,
                dssim_scale,
                per_value,
                epsilon,
                min_scale,
                max_scale,
                opaque,
                collect,
                visible_only,
                coefficients,
                sh_degree,
                depth_bits,
                longest_list,
                dilation,
                compensates,
                output,
                dropout_threshold,
                dropout_seed,
                fixed,
                padding,
                rates,
                decays,
            }
        );
        same_layout!(
            &module(&shader("scene2d/noise").text(Variant::default())),
            Noise { scale, seed, step, gaussians, fixed }
        );
        same_layout!(&module(include_str!("../shaders/show.wgsl")), Shown { width, encodes, unused });
        assert_eq!(u64::from(in_shader(m, "Splat").1), SPLAT_BYTES);
        assert_eq!(u64::from(in_shader(m, "Queued").1), QUEUED_BYTES);
        let m = &module(&shader("scene2d/solve_colors").text(Variant::default()));
        assert_eq!(u64::from(in_shader(m, "Conjugate").1), CONJUGATE_BYTES);
        assert_eq!(in_shader(m, "Scalars").1, 64);
        let m = &module(&shader("scene3d/project").text(Variant::default()));
        assert_eq!(in_shader(m, "Counted"), in_shader(m, "Status"));
        same_layout!(
            m,
            Camera {
                world_to_camera,
                position,
                near,
                focal,
                center,
                least_slope,
                most_slope,
                dilation,
                compensates,
                full_depth,
                unused,
            }
        );
    }

    #[test]
    #[should_panic(expected = "Gaussian")]
    fn the_comparison_detects_another_layout() {
        #[allow(dead_code)]
        #[repr(C)]
        struct Gaussian {
            mean: [f32; 3],
            opacity_logit: f32,
        }
        same_layout!(&module(&shader("edit").text(Variant::default())), Gaussian { mean, opacity_logit });
    }

    /// Every combination of the flags that select lines.
    fn variants() -> impl Iterator<Item = Variant> {
        (0..4096).map(|bits: u32| Variant {
            over: bits & 1 != 0,
            covariance_factor: bits & 2 != 0,
            lists: bits & 4 != 0,
            on_cpu: bits & 8 != 0,
            scene_3d: bits & 16 != 0,
            kernels: [Kernels::Portable, Kernels::Subgroups][(bits >> 5) as usize % 2],
            pass: [Pass::Forward, Pass::Backward][(bits >> 6) as usize % 2],
            by_pixel: bits & 128 != 0,
            collected: [
                Collected::Nothing,
                Collected::AbsoluteGradients,
                Collected::PixelCounts,
                Collected::PixelErrors,
            ][(bits >> 8) as usize % 4],
            // No shader depends on both.
            weighted: bits & 1024 != 0,
            packed: bits & 1024 != 0,
            camera: bits & 2048 != 0,
            ..Variant::default()
        })
    }

    #[test]
    fn every_variant_is_valid_and_within_the_default_limits() {
        let limits = wgpu::Limits::default();
        let mut seen = HashSet::new();
        // The names in conditions are looked up often, and searching the text takes time.
        let named = |shader: &crate::shaders::Shader| -> HashSet<&str> {
            shader.sources().flat_map(str::lines).filter_map(|line| line.trim().strip_prefix("#if ")).collect()
        };
        let shaders: Vec<_> = SHADERS.iter().map(|shader| (shader, named(shader))).collect();
        for ((shader, named), variant) in shaders.iter().flat_map(|shader| variants().map(move |v| (shader, v))) {
            let depends = |name: &str| named.contains(name);
            let selects = [
                (variant.covariance_factor, "COVARIANCE_FACTOR"),
                (variant.lists, "LISTS"),
                (variant.on_cpu, "ON_CPU"),
                (variant.scene_3d, "SCENE_3D"),
                (variant.by_pixel, "PER_PIXEL"),
                (variant.camera, "CAMERA"),
                (variant.pass == Pass::Backward, "BACKWARD"),
            ];
            let is_new = selects.iter().all(|(is_set, name)| !is_set || depends(name));
            if !is_new || (variant.packed && !depends("PACKED") && !depends("WEIGHTED")) {
                continue; // The text is that of a variant without this flag, and building it takes time.
            }
            let text = shader.text(variant);
            let is_compiled = match shader.name {
                "blend_by_depth" => variant.over,
                _ => true,
            };
            if !is_compiled || !seen.insert(text.clone()) {
                continue; // The text is the same as that of another variant.
            }
            let module = module(&text);
            let flags = naga::valid::ValidationFlags::all();
            // Only used where the adapter has subgroups.
            let capabilities = match (shader.name, variant.kernels) {
                ("blend_bwd", Kernels::Subgroups) => naga::valid::Capabilities::SUBGROUP,
                _ => naga::valid::Capabilities::empty(),
            };
            let info = naga::valid::Validator::new(flags, capabilities)
                .validate(&module)
                .unwrap_or_else(|e| panic!("{} {variant:?}: {}", shader.name, e.into_inner()));
            let names: Vec<&str> = module.entry_points.iter().map(|e| e.name.as_str()).collect();
            assert_eq!(names, shader.entry_points, "{}", shader.name);
            for (index, entry) in module.entry_points.iter().enumerate() {
                let used = |space: fn(&naga::AddressSpace) -> bool| {
                    let info = info.get_entry_point(index);
                    module.global_variables.iter().filter(move |(h, g)| !info[*h].is_empty() && space(&g.space))
                };
                let storage = used(|s| matches!(s, naga::AddressSpace::Storage { .. })).count() as u32;
                assert!(storage <= limits.max_storage_buffers_per_shader_stage, "{}: {storage} buffers", entry.name);
                let bytes: u32 = used(|s| *s == naga::AddressSpace::WorkGroup)
                    .map(|(_, g)| module.types[g.ty].inner.size(module.to_ctx()))
                    .sum();
                assert!(bytes <= limits.max_compute_workgroup_storage_size, "{}: {bytes} bytes", entry.name);
                let invocations: u32 = entry.workgroup_size.iter().product();
                assert!(invocations <= limits.max_compute_invocations_per_workgroup, "{}: {invocations}", entry.name);
            }
        }
    }
}
