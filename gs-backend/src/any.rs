//! Any of the backends behind one type.

use gs_core::{
    AdamRates, Backend, CameraGradient, Culled, DensityStatistics, EditPlan, Error, Image, Loss, MeanNoise, Optimizer,
    Parameterization, Rasterizer, RenderSettings, SavedState, Scene, Scene2d, Scene3d, SplatsState, TargetImage,
    TrainStep, Wait,
    profile::{Profile, Profiler},
};

/// A rasterizer of one of the backends of this build, for scenes of both kinds.
///
/// Its splats, passes, gradients and targets belong to its backend. Using them with a rasterizer of
/// another backend is an [`Error::State`].
#[derive(Debug)]
#[non_exhaustive]
pub enum AnyRasterizer {
    /// A rasterizer on the CPU.
    #[cfg(feature = "cpu")]
    Cpu(Box<gs_cpu::CpuRasterizer>),
    /// A rasterizer on a GPU.
    #[cfg(feature = "wgpu")]
    Wgpu(Box<gs_wgpu::WgpuRasterizer>),
}

/// A value that belongs to one of the backends.
#[derive(Debug)]
pub enum AnyOf<C, W> {
    /// A value of the CPU backend.
    Cpu(C),
    /// A value of the wgpu backend.
    Wgpu(W),
}

#[cfg(not(all(feature = "cpu", feature = "wgpu")))]
mod absent {
    /// A type that stands for one of a backend that this build lacks. It has no value.
    #[derive(Debug)]
    pub struct Absent<S>(std::convert::Infallible, std::marker::PhantomData<S>);
}

macro_rules! sides {
    ($($any:ident, $cpu:ident, $wgpu:ident: $of:ident, $text:literal;)*) => {$(
        #[cfg(feature = "cpu")]
        type $cpu<S> = <gs_cpu::CpuRasterizer as Rasterizer<S>>::$of;
        #[cfg(not(feature = "cpu"))]
        type $cpu<S> = absent::Absent<S>;
        #[cfg(feature = "wgpu")]
        type $wgpu<S> = <gs_wgpu::WgpuRasterizer as Rasterizer<S>>::$of;
        #[cfg(not(feature = "wgpu"))]
        type $wgpu<S> = absent::Absent<S>;
        #[doc = $text]
        pub type $any<S> = AnyOf<$cpu<S>, $wgpu<S>>;
    )*};
}

sides! {
    AnySplats, CpuSplats, WgpuSplats: Splats, "Splats of one of the backends.";
    AnyForwardPass, CpuForwardPass, WgpuForwardPass: ForwardPass, "A forward pass of one of the backends.";
    AnyGradients, CpuGradients, WgpuGradients: Gradients, "Gradients of one of the backends.";
    AnyTarget, CpuTarget, WgpuTarget: Target, "A target of one of the backends.";
}

impl AnyRasterizer {
    /// Short name of the backend: "cpu" or "wgpu".
    pub fn name(&self) -> &'static str {
        match self {
            #[cfg(feature = "cpu")]
            Self::Cpu(_) => "cpu",
            #[cfg(feature = "wgpu")]
            Self::Wgpu(_) => "wgpu",
        }
    }

    /// The name of the adapter, a GPU or a software driver; `None` on the CPU.
    pub fn adapter(&self) -> Option<&str> {
        match self {
            #[cfg(feature = "cpu")]
            Self::Cpu(_) => None,
            #[cfg(feature = "wgpu")]
            Self::Wgpu(on) => Some(&on.adapter().name),
        }
    }

    /// The name of the SIMD level; `None` on a GPU.
    pub fn simd_level(&self) -> Option<String> {
        match self {
            #[cfg(feature = "cpu")]
            Self::Cpu(on) => Some(on.simd_level().to_string()),
            #[cfg(feature = "wgpu")]
            Self::Wgpu(_) => None,
        }
    }
}

gs_core::impl_for_kinds!(AnyRasterizer);

fn mismatch() -> Error {
    Error::State("splats, passes, gradients and targets of one backend are used with another".to_owned())
}

/// Runs `$work` if this rasterizer and all of `$value` are of one backend, and `$otherwise` if not,
/// an error unless given. In `$work`, `$any` makes an [`AnyOf`] of a value of that backend.
macro_rules! on {
    ($self:ident as $on:ident $(for $any:ident)?, $($value:ident),* => $work:expr) => {
        on!($self as $on $(for $any)?, $($value),* => $work, else Err(mismatch()))
    };
    ($self:ident as $on:ident $(for $any:ident)?, $($value:ident),* => $work:expr, else $otherwise:expr) => {
        match ($self, $($value),*) {
            #[cfg(feature = "cpu")]
            (Self::Cpu($on), $(AnyOf::Cpu($value)),*) => {
                let $on = $on.as_ref();
                $(let $any = AnyOf::Cpu;)?
                $work
            }
            #[cfg(feature = "wgpu")]
            (Self::Wgpu($on), $(AnyOf::Wgpu($value)),*) => {
                let $on = $on.as_ref();
                $(let $any = AnyOf::Wgpu;)?
                $work
            }
            #[allow(unreachable_patterns)]
            _ => $otherwise,
        }
    };
}

impl Backend for AnyRasterizer {
    fn describe(&self) -> String {
        match self {
            #[cfg(feature = "cpu")]
            Self::Cpu(on) => on.describe(),
            #[cfg(feature = "wgpu")]
            Self::Wgpu(on) => on.describe(),
        }
    }
}

macro_rules! for_scene {
    ($scene:ty) => {
        impl Rasterizer<$scene> for AnyRasterizer {
            type Splats = AnySplats<$scene>;
            type ForwardPass = AnyForwardPass<$scene>;
            type Gradients = AnyGradients<$scene>;
            type Target = AnyTarget<$scene>;

            fn upload(&self, scene: &$scene, parameterization: Parameterization) -> Result<Self::Splats, Error> {
                on!(self as on for any, => on.upload(scene, parameterization).map(any))
            }

            async fn forward(
                &self,
                splats: &Self::Splats,
                view: &<$scene as Scene>::View,
                settings: &RenderSettings,
            ) -> Result<Self::ForwardPass, Error> {
                on!(self as on for any, splats => on.forward(splats, view, settings).await.map(any))
            }

            async fn image(&self, pass: &Self::ForwardPass) -> Result<Image, Error> {
                on!(self as on, pass => Rasterizer::<$scene>::image(on, pass).await)
            }

            /// Counts the culled Gaussians; all counts are 0 for a pass of another backend.
            fn culled(&self, pass: &Self::ForwardPass) -> Culled {
                on!(self as on, pass => Rasterizer::<$scene>::culled(on, pass), else Culled::default())
            }

            fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, Error> {
                on!(self as on for any, => Rasterizer::<$scene>::upload_target(on, target).map(any))
            }

            async fn backward(
                &self,
                splats: &Self::Splats,
                pass: Self::ForwardPass,
                target: &Self::Target,
                loss: &Loss,
            ) -> Result<(f32, Self::Gradients), Error> {
                on!(self as on for any, splats, pass, target => {
                    let found = Rasterizer::<$scene>::backward(on, splats, pass, target, loss).await;
                    found.map(|(loss, gradients)| (loss, any(gradients)))
                })
            }

            async fn loss(
                &self,
                splats: &Self::Splats,
                pass: Self::ForwardPass,
                target: &Self::Target,
                loss: &Loss,
            ) -> Result<f32, Error> {
                on!(self as on, splats, pass, target => {
                    Rasterizer::<$scene>::loss(on, splats, pass, target, loss).await
                })
            }

            async fn image_vjp(
                &self,
                splats: &Self::Splats,
                pass: Self::ForwardPass,
                v_image: &Image,
            ) -> Result<Self::Gradients, Error> {
                on!(self as on for any, splats, pass => {
                    Rasterizer::<$scene>::image_vjp(on, splats, pass, v_image).await.map(any)
                })
            }

            async fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> Result<$scene, Error> {
                on!(self as on, splats, gradients => on.gradients(splats, gradients).await)
            }

            async fn camera_gradient(&self, gradients: &Self::Gradients) -> Result<CameraGradient, Error> {
                on!(self as on, gradients => Rasterizer::<$scene>::camera_gradient(on, gradients).await)
            }

            async fn download(&self, splats: &Self::Splats) -> Result<$scene, Error> {
                on!(self as on, splats => on.download(splats).await)
            }

            /// 0 for splats of another backend.
            fn len(&self, splats: &Self::Splats) -> usize {
                on!(self as on, splats => Rasterizer::<$scene>::len(on, splats), else 0)
            }

            async fn draw(
                &self,
                splats: &Self::Splats,
                view: &<$scene as Scene>::View,
                settings: &RenderSettings,
            ) -> Result<(Image, Culled), Error> {
                on!(self as on, splats => Rasterizer::<$scene>::draw(on, splats, view, settings).await)
            }
        }

        impl Optimizer<$scene> for AnyRasterizer {
            async fn train_step(
                &self,
                splats: &mut Self::Splats,
                view: &<$scene as Scene>::View,
                target: &Self::Target,
                step: &TrainStep<'_>,
            ) -> Result<(), Error> {
                on!(self as on, splats, target => {
                    Optimizer::<$scene>::train_step(on, splats, view, target, step).await
                })
            }

            async fn losses(&self, splats: &mut Self::Splats, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
                on!(self as on, splats => Optimizer::<$scene>::losses(on, splats, wait, losses).await)
            }

            async fn camera_gradients(
                &self,
                splats: &mut Self::Splats,
                wait: Wait,
                gradients: &mut Vec<CameraGradient>,
            ) -> Result<(), Error> {
                on!(self as on, splats => Optimizer::<$scene>::camera_gradients(on, splats, wait, gradients).await)
            }

            async fn step(
                &self,
                splats: &mut Self::Splats,
                gradients: &Self::Gradients,
                rates: &AdamRates,
            ) -> Result<(), Error> {
                on!(self as on, splats, gradients => Optimizer::<$scene>::step(on, splats, gradients, rates).await)
            }

            async fn statistics(&self, splats: &Self::Splats) -> Result<DensityStatistics, Error> {
                on!(self as on, splats => Optimizer::<$scene>::statistics(on, splats).await)
            }

            async fn edit(
                &self,
                splats: &mut Self::Splats,
                plan: &EditPlan<<$scene as Scene>::Gaussian>,
            ) -> Result<(), Error> {
                on!(self as on, splats => Optimizer::<$scene>::edit(on, splats, plan).await)
            }

            fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), Error> {
                on!(self as on, splats => Optimizer::<$scene>::add_noise(on, splats, noise))
            }

            async fn solve_colors(
                &self,
                splats: &mut Self::Splats,
                view: &<$scene as Scene>::View,
                target: &Self::Target,
                settings: &RenderSettings,
                iterations: u32,
            ) -> Result<(), Error> {
                on!(self as on, splats, target => {
                    Optimizer::<$scene>::solve_colors(on, splats, view, target, settings, iterations).await
                })
            }

            async fn save(&self, splats: &Self::Splats) -> Result<SplatsState, Error> {
                on!(self as on, splats => Optimizer::<$scene>::save(on, splats).await)
            }

            async fn saved<'s>(&self, splats: &'s Self::Splats) -> Result<SavedState<'s>, Error> {
                on!(self as on, splats => Optimizer::<$scene>::saved(on, splats).await)
            }

            fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error> {
                on!(self as on for any, => Optimizer::<$scene>::restore(on, state).map(any))
            }
        }

        impl Profiler<$scene> for AnyRasterizer {
            async fn profile(
                &self,
                splats: &mut Self::Splats,
                view: &<$scene as Scene>::View,
                target: &Self::Target,
                settings: &RenderSettings,
                loss: Loss,
                repetitions: usize,
            ) -> Result<Profile, Error> {
                on!(self as on, splats, target => {
                    Profiler::<$scene>::profile(on, splats, view, target, settings, loss, repetitions).await
                })
            }
        }
    };
}

for_scene!(Scene2d);
for_scene!(Scene3d);
