//! The buffers from projection to its backward pass, and the stages that work on them, for 2D and
//! 3D scenes alike.

use std::ops::Range;

use glam::Vec2;
use gs_core::{
    Blend, Culled, Effects, Error, Loss, RenderSettings,
    effects::{Order, Statistics},
    memory,
};

use crate::{
    bin::Bins,
    blend_over,
    blend_per_pixel::{self, Scratch},
    blend_sum,
    collect::{Nothing, collecting, numbers},
    dssim,
    layout::{Grid, MOST_ROWS_OVER, Row, ScalarRow, TileBuffers, for_each_tile},
    level::{Level, dispatch},
    pointwise::{Compared, squares_in_place},
    scratches::Scratches,
    slots::Slots,
    splat::{PixelDepth, Received, Splat},
    target::Target,
    tile_inputs::TileInputs,
};

/// Rows of a tile under `Sum`: a strip is one tile as long as it fits into the second-level cache.
const SUM_BAND_ROWS: usize = 1024;

/// Rows of a tile under `Over`, where the entries are not in the order of rows: the tile should
/// stay in the first-level cache.
const OVER_BAND_ROWS: usize = MOST_ROWS_OVER;

/// Projected splats, their lists per tile, images and gradients.
///
/// A *rank* is a splat's number in the order in which tiles see the splats.
#[derive(Debug, Default)]
pub(crate) struct Tiles {
    pub(crate) settings: RenderSettings,
    pub(crate) grid: Grid,
    /// Splats, in an order of the scene's kind. Unspecified for Gaussians that have no rank.
    pub(crate) projected: Vec<Splat>,
    /// Depths of `projected`; only in 3D scenes.
    pub(crate) depths: Vec<PixelDepth>,
    scratches: Scratches<Scratch>,
    /// Rows of a tile, for passes that need them no longer than that tile.
    pub(crate) tile_rows: Scratches<Vec<Row>>,
    pub(crate) bins: Bins,
    /// The image, or the strips of it that were drawn last.
    pub(crate) rows: Vec<Row>,
    pub(crate) transmittance: Vec<ScalarRow>,
    /// ∂L/∂image.
    pub(crate) v_rows: Vec<Row>,
    /// The mean of |C − Y| over a pixel's channels, 0 in lanes beyond the image; empty where no
    /// statistic needs it.
    pub(crate) errors: Vec<ScalarRow>,
    /// The gradient of each entry.
    pub(crate) slots: Slots,
    /// Numbers per entry in `slots`.
    pub(crate) stride: usize,
    /// A partial sum per tile.
    pub(crate) sums: Vec<f64>,
    /// Number of Gaussians that projection left out, by cause.
    pub(crate) culled: Culled,
    pub(crate) dssim: dssim::Scratch,
    /// The last masked target, completed with the background and the rendering.
    pub(crate) completed: Target,
}

/// What the blend kernels read.
#[derive(Clone, Copy)]
struct Lists<'a> {
    settings: &'a RenderSettings,
    grid: &'a Grid,
    projected: &'a [Splat],
    depths: &'a [PixelDepth],
    bins: &'a Bins,
}

impl<'a> Lists<'a> {
    fn of(&self, tile: usize) -> TileInputs<'a> {
        let (first_column, rows) = self.grid.place(tile);
        TileInputs {
            entries: self.bins.of(tile),
            projected: self.projected,
            depths: self.depths,
            accuracy: &self.settings.accuracy,
            first_column,
            first_row: rows.start,
            lanes_inside: self.grid.lanes_inside(tile),
        }
    }
}

impl Tiles {
    /// Sets the image's size and the settings.
    pub(crate) fn set(&mut self, size: (u32, u32), settings: &RenderSettings) {
        let band_rows = match settings.effects.blend {
            Blend::Sum => SUM_BAND_ROWS,
            Blend::Over => OVER_BAND_ROWS,
        };
        self.settings = *settings;
        self.grid = Grid::new(size, band_rows);
    }

    /// Resizes the buffers that several stages from `blend` on share.
    pub(crate) fn fit(&mut self) {
        self.stride = self.gradient_stride() + numbers(self.settings.effects.statistics);
        self.sums.resize(self.grid.tiles(), 0.0);
        self.tile_rows.fit();
        if self.settings.effects.order == Order::PerPixel {
            self.scratches.fit();
        }
    }

    /// Numbers per entry in `slots` that are gradients. Those of the statistics follow.
    fn gradient_stride(&self) -> usize {
        match self.settings.effects.blend {
            Blend::Sum => blend_sum::STRIDE,
            Blend::Over => blend_over::STRIDE,
        }
    }

    /// Whether the backward pass needs the pixels' errors.
    pub(crate) fn collects_errors(&self) -> bool {
        self.settings.effects.statistics == Statistics::PixelError
    }

    /// Half the image's size: the factor from gradients in px⁻¹ to normalised device units.
    pub(crate) fn half_size(&self) -> Vec2 {
        Vec2::new(self.grid.width as f32, self.grid.height as f32) * 0.5
    }

    /// Number of Gaussians that the forward pass left out, by cause.
    pub(crate) fn culled(&self) -> Culled {
        self.culled.plus(Culled { outside: self.bins.outside, ..Culled::default() })
    }

    /// Runs stage `bin`. The splat at `rank` in 0..`count` is `projected[splat_at(rank)]`.
    ///
    /// # Errors
    /// Those of [`Bins::fill`].
    pub(crate) fn bin(
        &mut self,
        level: Level,
        count: usize,
        splat_at: impl Fn(usize) -> usize + Sync,
    ) -> Result<(), Error> {
        self.bins.fill(level, &self.projected, (count, splat_at), &self.grid)
    }

    /// Runs stage `blend`: draws the image into `rows`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend(&mut self, level: Level) -> Result<(), Error> {
        self.blend_tiles(level, 0..self.grid.tiles())
    }

    /// Draws these tiles, which are whole strips, into `rows`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_tiles(&mut self, level: Level, tiles: Range<usize>) -> Result<(), Error> {
        let Effects { blend, order, .. } = self.settings.effects;
        let background = self.settings.background_color();
        let count = self.grid.first_row(tiles.end) - self.grid.first_row(tiles.start);
        memory::resize(&mut self.rows, count, Row::ZERO, "the strips of an image")?;
        let transmittances = if blend == Blend::Over { count } else { 0 };
        memory::resize(&mut self.transmittance, transmittances, ScalarRow([1.0; 16]), "the pixels' transmittances")?;
        let Self { settings, grid, projected, depths, bins, rows, transmittance, scratches, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows, scalars: transmittance, sums: &mut [] };
        for_each_tile(tiles, buffers, grid, &|tile, buffers| {
            let TileBuffers { rows, scalars, .. } = buffers;
            let inputs = lists.of(tile);
            match (blend, order) {
                (Blend::Sum, _) => {
                    rows.fill(Row(background.map(|c| [c; 16])));
                    let TileInputs { entries, projected, first_column, first_row, .. } = inputs;
                    dispatch!(level, simd => blend_sum::forward(simd, entries, projected, first_column, first_row, rows));
                }
                (Blend::Over, Order::PerPixel) => scratches.with(|scratch| {
                    blend_per_pixel::forward(level, &inputs, scratch, rows, scalars, background);
                }),
                (Blend::Over, _) => {
                    dispatch!(level, simd => blend_over::forward(simd, &inputs, rows, scalars, background))
                }
            }
        });
        Ok(())
    }

    /// Resizes `slots` to `stride` numbers per entry.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn fit_slots(&mut self, stride: usize) -> Result<(), Error> {
        self.slots.fit(self.bins.entries.len() * stride)
    }

    /// Runs stage `blend_bwd`: from `v_rows` into `slots`. Under `Over` it overwrites the image.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_bwd(&mut self, level: Level) -> Result<(), Error> {
        let Effects { blend, order, statistics, .. } = self.settings.effects;
        self.fit_slots(self.stride)?;
        let Self { settings, grid, projected, depths, bins, rows, v_rows, errors, slots, scratches, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows, scalars: &mut [], sums: &mut [] };
        let slots = &*slots;
        for_each_tile(0..grid.tiles(), buffers, grid, &|tile, buffers| {
            let TileBuffers { rows, .. } = buffers;
            let inputs = lists.of(tile);
            let of_tile = grid.first_row(tile)..grid.first_row(tile) + rows.len();
            let errors = if errors.is_empty() { &[] } else { &errors[of_tile.clone()] };
            let v_rows = &v_rows[of_tile];
            collecting!(statistics, K => match (blend, order) {
                (Blend::Sum, _) => {
                    let TileInputs { entries, projected, first_column, first_row, lanes_inside, .. } = inputs;
                    dispatch!(level, simd => blend_sum::backward::<_, K>(
                        simd, entries, projected, first_column, first_row, lanes_inside, v_rows, errors, slots,
                    ));
                }
                (Blend::Over, Order::PerPixel) => scratches.with(|scratch| {
                    blend_per_pixel::backward::<K>(level, &inputs, scratch, rows, v_rows, errors, slots);
                }),
                (Blend::Over, _) => dispatch!(level, simd => blend_over::backward::<_, K>(
                    simd, &inputs, rows, v_rows, errors, slots,
                )),
            });
        });
        Ok(())
    }

    /// Whether a training step runs [`Self::blend_l2_fused`]. That kernel has no sums for
    /// statistics.
    pub(crate) fn is_fused(effects: &Effects, loss: Loss) -> bool {
        loss == Loss::L2 && effects.blend == Blend::Sum && numbers(effects.statistics) == 0
    }

    /// Runs stages `blend`, `loss` (L2) and `blend_bwd` in one pass over the tiles; `Sum` only.
    ///
    /// Each tile stays in the cache. Returns Σ w (C − Y)², where w are the pixels' weights; `slots`
    /// receive the gradients of half of that. C has the same bits as in [`Self::blend`], so that loss and gradient are exactly 0 if
    /// a rendering is the target: Adam would turn a rounding error into a whole step.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_l2_fused(&mut self, level: Level, target: &Target) -> Result<f64, Error> {
        let background = self.settings.background_color();
        self.fit_slots(self.stride)?;
        let Self { settings, grid, projected, depths, bins, tile_rows, slots, sums, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows: &mut [], scalars: &mut [], sums };
        let slots = &*slots;
        for_each_tile(0..grid.tiles(), buffers, grid, &|tile, buffers| {
            let TileInputs { entries, projected, first_column: column, first_row, lanes_inside: inside, .. } =
                lists.of(tile);
            let of_tile = grid.first_row(tile)..grid.first_row(tile + 1);
            let (target, weights) = (&target.rows[of_tile.clone()], target.weights_of(of_tile));
            tile_rows.with(|rows| {
                rows.resize(target.len(), Row::ZERO);
                dispatch!(level, simd => {
                    rows.fill(Row(background.map(|c| [c; 16])));
                    blend_sum::forward(simd, entries, projected, column, first_row, rows);
                    buffers.sums[0] = squares_in_place(simd, rows, Compared { target, weights, inside });
                    blend_sum::backward::<_, Nothing>(
                        simd, entries, projected, column, first_row, inside, rows, &[], slots,
                    );
                });
            });
        });
        Ok(self.sums.iter().sum())
    }

    /// Whether some tile lists `projected[index]`.
    #[inline(always)]
    pub(crate) fn lists(&self, index: usize) -> bool {
        !self.bins.slots_of(index).is_empty()
    }

    /// The gradient of `projected[index]`: its slots, summed in the order of its tiles. `None` where no
    /// tile lists it.
    #[inline(always)]
    pub(crate) fn received(&self, index: usize) -> Option<Received> {
        let slots = self.bins.slots_of(index);
        if slots.is_empty() {
            return None;
        }
        let [r, g, b, x, u, xx, xu, uu, rest @ ..]: [f32; 11] = self.slots.sums(slots, self.stride);
        let (zeroth, collected) = match self.settings.effects.blend {
            Blend::Over => (rest[0], [rest[1], rest[2]]),
            Blend::Sum => (0.0, [rest[0], rest[1]]),
        };
        Some(Received { color: [r, g, b], first: Vec2::new(x, u), second: [xx, xu, uu], zeroth, collected })
    }
}

const _: () = assert!(blend_sum::STRIDE == 8 && blend_over::STRIDE == 9, "`Tiles::received` knows these numbers");
