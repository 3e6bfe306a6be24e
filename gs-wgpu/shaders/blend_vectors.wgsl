// Stages `blend`, `loss` (pointwise) and `blend_bwd` where an invocation is a lane of a CPU's vector. A work group is one subgroup, a
// tile its own; a lane has COLUMNS columns of it, and `@c` and `@r` count columns and rows. FORWARD stores the image, BACKWARD reads
// v_image, the image's gradient, and with both, one pass does all.
//
// Such an adapter executes both sides of every branch and the loops' bodies once more than a test at their head would let through; so
// there are few branches, and loops end at their tail. What a lane reads from a buffer costs as much as ten operations; so each lane
// fetches one of LANES entries, and hands it to all.
//
// Under `Sum` the weights of a column are e^-s for s quadratic in the row: from one row to the next they grow by a factor that itself
// grows by e^-c. That runs both ways from the middle row, and not for the entries of a tile's second list, which are too steep.
//
// Legend of BACKWARD: t = w v_w (under `Over` alpha v_alpha); a slot: v_colour 3, then the sums over the entry's pixels of t dx, t u,
// t dx², t dx u, t u²; under `Over` also of t; then what statistics need: with ABSOLUTE the sums of the magnitudes of t Sigma'^-1 d, with
// ERROR of what a pixel shows of the Gaussian times the pixel's error.

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> projected: array<Splat>;
#if BACKWARD
@group(0) @binding(5) var<storage, read_write> slots: array<f32>;
#if FORWARD
@group(0) @binding(6) var<storage, read> target_image: array<vec4f>;
// One number a tile.
@group(0) @binding(7) var<storage, read_write> partial: array<f32>;
#else
// With the image, it keeps the pixels' state between SEGMENTED walks under `Over`.
#if CARRIES
@group(0) @binding(6) var<storage, read_write> v_image: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> image: array<vec4f>;
#else
@group(0) @binding(6) var<storage, read> v_image: array<vec4f>;
#if OVER_OR_ERROR
@group(0) @binding(7) var<storage, read> image: array<vec4f>;
#endif
#endif
#if ERROR
@group(0) @binding(8) var<storage, read> target_image: array<vec4f>;
#endif
#endif
#else
// RGB, and the transmittance under `Over`.
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;
#endif

#if FORWARD
#if BACKWARD
// 1: L2. 2: L1.
override KIND: u32 = 1u;
#endif
#endif

@compute @workgroup_size(LANES)
fn blend_vectors(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let first_y = f32(corner.y) + 0.5;
    let middle_y = first_y + 0.5 * f32(BLOCK);
    let walk = walk_along(tile_start[2u * tile], tile_start[2u * tile + 2u]);
    if !is_due(walk) {
        return;
    }
    let start = walk.first;
    let end = walk.end;
    let steep = clamp(tile_start[2u * tile + 1u], start, end);
#each c COLUMNS
    let column_@c = corner.x + lane + @cu * LANES;
    let x_@c = f32(column_@c) + 0.5;
#end
#if FORWARD
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    var p_@c_@b@r: Pixel;
#if OVER
    p_@c_@b@r.transmittance = 1.0;
#endif
#if SEGMENTED
    if !walk.begins && column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y {
        let before = image[(corner.y + @bu * BLOCK + @ru) * step.size.x + column_@c];
        p_@c_@b@r.color = before.xyz;
#if OVER
        p_@c_@b@r.transmittance = before.w;
#endif
    }
#endif
#end
#end
#end
#if OVER
#else
    if start < steep {
        var first = start;
        loop {
            let many = min(LANES, steep - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
#each c COLUMNS
                let dx_@c = x_@c - s.mean.x;
                let across_@c = dx_@c * dx_@c * s.across;
                let u_@c_0 = (middle_y - s.mean.y) - s.slope * dx_@c;
                let u_@c_1 = u_@c_0 + f32(BLOCK);
                let middle_@c_0 = exp2_exact(across_@c + u_@c_0 * u_@c_0 * s.curve);
                let middle_@c_1 = exp2_exact(across_@c + u_@c_1 * u_@c_1 * s.curve);
                let growth_@c_0 = exp2_within((2.0 * u_@c_0 + 1.0) * s.curve);
                let growth_@c_1 = exp2_within((2.0 * u_@c_1 + 1.0) * s.curve);
#each b BLOCKS
                var w_@c_@b = middle_@c_@b;
                var g_@c_@b = growth_@c_@b;
#end
#end
#each r UP
#each c COLUMNS
#each b BLOCKS
                p_@c_@b@r = with_share(p_@c_@b@r, w_@c_@b, s.color);
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
#end
#end
#end
#each c COLUMNS
#each b BLOCKS
                w_@c_@b = middle_@c_@b;
                g_@c_@b = s.extra / growth_@c_@b;
#end
#end
#each r DOWN
#each c COLUMNS
#each b BLOCKS
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
                p_@c_@b@r = with_share(p_@c_@b@r, w_@c_@b, s.color);
#end
#end
#end
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= steep;
            }
        }
    }
#endif
    if steep < end {
        var first = steep;
        loop {
            let many = min(LANES, end - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
#each c COLUMNS
                let dx_@c = x_@c - s.mean.x;
                let u_@c = (first_y - s.mean.y) - s.slope * dx_@c;
                let across_@c = exponent_across(s, dx_@c);
#each b BLOCKS
#each r BLOCK
                p_@c_@b@r = with_share(p_@c_@b@r, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), s.color);
#end
#end
#end
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= end;
            }
        }
    }
#if BACKWARD
    var loss = 0.0;
#else
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    if column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y {
#if OVER
        let left = p_@c_@b@r.transmittance;
        let drawn = vec4f(p_@c_@b@r.color + abs(left) * step.background, abs(left));
#else
        let left = 0.0;
        let drawn = vec4f(p_@c_@b@r.color + step.background, 0.0);
#endif
        image[(corner.y + @bu * BLOCK + @ru) * step.size.x + column_@c] = select(vec4f(p_@c_@b@r.color, left), drawn, walk.ends);
    }
#end
#end
#end
#endif
#endif

#if BACKWARD
    // Read in a loop that the compiler cannot unroll: the instructions of what follows fill the cache as it is.
#each c COLUMNS
    var read_@c: array<vec3f, ROWS>;
#if OVER_OR_ERROR
#if FORWARD
#else
    var color_@c: array<vec3f, ROWS>;
#endif
#endif
#if ERROR
#if FORWARD
#else
    var error_@c: array<f32, ROWS>;
#endif
#endif
#if CARRIES
    // Transmittance and rest.
    var carried_@c: array<vec2f, ROWS>;
#endif
#end
    let rows = min(ROWS, step.size.y - corner.y);
    var row = 0u;
    loop {
        let pixel = (corner.y + row) * step.size.x;
#each c COLUMNS
        if column_@c < step.size.x {
#if FORWARD
            read_@c[row] = target_image[pixel + column_@c].xyz;
#else
            read_@c[row] = v_image[pixel + column_@c].xyz;
#if OVER_OR_ERROR
            color_@c[row] = image[pixel + column_@c].xyz;
#endif
#if ERROR
            error_@c[row] = dot(abs(color_@c[row] - target_image[pixel + column_@c].xyz), vec3f(1.0 / 3.0));
#endif
#if CARRIES
            carried_@c[row] = vec2f(image[pixel + column_@c].w, v_image[pixel + column_@c].w);
#endif
#endif
        }
#end
        continuing {
            row++;
            break if row >= rows;
        }
    }
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    var v_@c_@b@r: Gathering;
    {
#if FORWARD
#if OVER
        let color = p_@c_@b@r.color + abs(p_@c_@b@r.transmittance) * step.background;
#else
        let color = p_@c_@b@r.color + step.background;
#endif
        let inside = column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y;
        let d = select(vec3f(0.0), color - read_@c[@bu * BLOCK + @ru], inside);
        let is_square = KIND == 1u;
        let values = select(abs(d), d * d, is_square);
        loss += values.x + values.y + values.z;
#if ERROR
        v_@c_@b@r.error = dot(abs(d), vec3f(1.0 / 3.0));
#endif
        let bounded = clamp(d, vec3f(-MAX_RESIDUAL), vec3f(MAX_RESIDUAL));
        v_@c_@b@r.v = step.pointwise_scale * select(sign(d), 2.0 * bounded, is_square);
#else
        v_@c_@b@r.v = read_@c[@bu * BLOCK + @ru];
#if ERROR
        v_@c_@b@r.error = error_@c[@bu * BLOCK + @ru];
#endif
#if OVER
        let color = color_@c[@bu * BLOCK + @ru];
#endif
#endif
#if OVER
        v_@c_@b@r.transmittance = 1.0;
        v_@c_@b@r.rest = dot(v_@c_@b@r.v, color);
#endif
#if CARRIES
        if !walk.begins {
            v_@c_@b@r.transmittance = carried_@c[@bu * BLOCK + @ru].x;
            v_@c_@b@r.rest = carried_@c[@bu * BLOCK + @ru].y;
        }
#endif
    }
#end
#end
#end
#if FORWARD
    let loss_of_tile = sum_of_lanes(loss);
    if lane == 0u {
        partial[tile] = loss_of_tile;
    }
#endif
#if OVER
#else
    if start < steep {
        var first = start;
        loop {
            let many = min(LANES, steep - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
                var a = vec4f(0.0);
                var b = vec4f(0.0);
#if COLLECTS
                var collected = vec2f(0.0);
#endif
#each c COLUMNS
                var sums_@c = no_sums();
                let dx_@c = x_@c - s.mean.x;
                let across_@c = dx_@c * dx_@c * s.across;
                let u_@c_0 = (middle_y - s.mean.y) - s.slope * dx_@c;
                let u_@c_1 = u_@c_0 + f32(BLOCK);
                let middle_@c_0 = exp2_exact(across_@c + u_@c_0 * u_@c_0 * s.curve);
                let middle_@c_1 = exp2_exact(across_@c + u_@c_1 * u_@c_1 * s.curve);
                let growth_@c_0 = exp2_within((2.0 * u_@c_0 + 1.0) * s.curve);
                let growth_@c_1 = exp2_within((2.0 * u_@c_1 + 1.0) * s.curve);
#each b BLOCKS
                var w_@c_@b = middle_@c_@b;
                var g_@c_@b = growth_@c_@b;
#end
#end
#each r UP
#each c COLUMNS
#each b BLOCKS
                gather(v_@c_@b@r, &sums_@c, w_@c_@b, u_@c_@b + (@r.0 - 0.5 * f32(BLOCK)), s, dx_@c);
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
#end
#end
#end
#each c COLUMNS
#each b BLOCKS
                w_@c_@b = middle_@c_@b;
                g_@c_@b = s.extra / growth_@c_@b;
#end
#end
#each r DOWN
#each c COLUMNS
#each b BLOCKS
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
                gather(v_@c_@b@r, &sums_@c, w_@c_@b, u_@c_@b + (@r.0 - 0.5 * f32(BLOCK)), s, dx_@c);
#end
#end
#end
#each c COLUMNS
                sums_@c.t = dot(sums_@c.color, s.color);
                a += vec4f(sums_@c.color, sums_@c.t * dx_@c);
                b += vec4f(sums_@c.tu, sums_@c.t * dx_@c * dx_@c, sums_@c.tu * dx_@c, sums_@c.tuu);
#if COLLECTS
                collected += sums_@c.collected;
#endif
#end
                slots[s.slot * STRIDE + lane] = sums_by_lane(a, b, lane);
#if COLLECTS
                store_collected(s.slot, collected, lane);
#endif
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= steep;
            }
        }
    }
#endif
    if steep < end {
        var first = steep;
        loop {
            let many = min(LANES, end - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
                var a = vec4f(0.0);
                var b = vec4f(0.0);
#if COLLECTS
                var collected = vec2f(0.0);
#endif
                var t = 0.0;
#each c COLUMNS
                var sums_@c = no_sums();
                let dx_@c = x_@c - s.mean.x;
                let u_@c = (first_y - s.mean.y) - s.slope * dx_@c;
                let across_@c = exponent_across(s, dx_@c);
#each b BLOCKS
#each r BLOCK
#if OVER
                v_@c_@b@r = gather(v_@c_@b@r, &sums_@c, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), u_@c + (@b.0 * f32(BLOCK) + @r.0), s, dx_@c);
#else
                gather(v_@c_@b@r, &sums_@c, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), u_@c + (@b.0 * f32(BLOCK) + @r.0), s, dx_@c);
#endif
#end
#end
#if OVER
                t += sums_@c.t;
#else
                sums_@c.t = dot(sums_@c.color, s.color);
#endif
                a += vec4f(sums_@c.color, sums_@c.t * dx_@c);
                b += vec4f(sums_@c.tu, sums_@c.t * dx_@c * dx_@c, sums_@c.tu * dx_@c, sums_@c.tuu);
#if COLLECTS
                collected += sums_@c.collected;
#endif
#end
                slots[s.slot * STRIDE + lane] = sums_by_lane(a, b, lane);
#if COLLECTS
                store_collected(s.slot, collected, lane);
#endif
#if OVER
                let all = sum_of_lanes(t);
                if lane == 0u {
                    slots[s.slot * STRIDE + 8u] = all;
                }
#endif
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= end;
            }
        }
    }
#if CARRIES
    if !walk.ends {
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
        if column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y {
            let pixel = (corner.y + @bu * BLOCK + @ru) * step.size.x + column_@c;
            image[pixel].w = v_@c_@b@r.transmittance;
            v_image[pixel].w = v_@c_@b@r.rest;
        }
#end
#end
#end
    }
#endif
#endif
}
