// The camera, and the projection of a Gaussian, as in gs-core's `perspective` and `sh`.

#import prelude: QUATERNION_SHRINK, SAFE_SQUARE_LEAST, SAFE_SQUARE_MOST, SH_C0, SH_C1, SH_C2, SH_C3
#import shared: Ellipsoid, exp_exact, is_finite

struct Camera {
    // Rows of W, each with its component of t.
    world_to_camera: array<vec4f, 3>,
    position: vec3f,
    near: f32,
    focal: vec2f,
    center: vec2f,
    // Bounds of the Jacobian's slopes.
    least_slope: vec2f,
    most_slope: vec2f,
    // The dilation of Sigma', px², and 1 if the opacity compensates for it.
    dilation: f32,
    compensates: u32,
    // Depth from which gradients count fully in a statistic weighted by depth; 0 if all do.
    full_depth: f32,
    unused: u32,
}

fn all_finite(v: vec3f) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

fn in_camera(camera: Camera, mean: vec3f) -> vec3f {
    let w = camera.world_to_camera;
    return vec3f(dot(w[0].xyz, mean) + w[0].w, dot(w[1].xyz, mean) + w[1].w, dot(w[2].xyz, mean) + w[2].w);
}

// W^T v.
fn in_world(camera: Camera, v: vec3f) -> vec3f {
    let w = camera.world_to_camera;
    return w[0].xyz * v.x + w[1].xyz * v.y + w[2].xyz * v.z;
}

// W v.
fn turned(camera: Camera, v: vec3f) -> vec3f {
    let w = camera.world_to_camera;
    return vec3f(dot(w[0].xyz, v), dot(w[1].xyz, v), dot(w[2].xyz, v));
}

// A quaternion times a power of two that keeps its square finite, and that power.
struct Quaternion {
    scaled: vec4f,
    scale: f32,
}

fn quaternion(q: vec4f) -> Quaternion {
    let huge = !is_finite(dot(q, q));
    let scale = select(1.0, QUATERNION_SHRINK, huge);
    return Quaternion(q * scale, scale);
}

// Legend: m = rows of W R S, r = rows of M' = J W R S.
struct Intermediate {
    m: array<vec3f, 3>,
    r0: vec3f,
    r1: vec3f,
    inverse_z: f32,
    slope: vec2f,
    clamped: vec2f,
    // q/|q| and 1/|q|.
    unit: vec4f,
    inverse_norm: f32,
}

fn intermediate(camera: Camera, e: Ellipsoid, p: vec3f) -> Intermediate {
    var i: Intermediate;
    let q = quaternion(e.rotation);
    i.inverse_norm = 1.0 / sqrt(dot(q.scaled, q.scaled));
    i.unit = q.scaled * i.inverse_norm;
    i.inverse_norm *= q.scale;
    let w = i.unit.x;
    let x = i.unit.y;
    let y = i.unit.z;
    let z = i.unit.w;
    let first = vec3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y));
    let second = vec3f(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x));
    let third = vec3f(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
    let scale = vec3f(exp_exact(e.log_scale.x), exp_exact(e.log_scale.y), exp_exact(e.log_scale.z));
    let rows = camera.world_to_camera;
    i.m[0] = vec3f(dot(rows[0].xyz, first), dot(rows[0].xyz, second), dot(rows[0].xyz, third)) * scale;
    i.m[1] = vec3f(dot(rows[1].xyz, first), dot(rows[1].xyz, second), dot(rows[1].xyz, third)) * scale;
    i.m[2] = vec3f(dot(rows[2].xyz, first), dot(rows[2].xyz, second), dot(rows[2].xyz, third)) * scale;
    i.inverse_z = 1.0 / p.z;
    i.slope = p.xy * i.inverse_z;
    i.clamped = min(max(i.slope, camera.least_slope), camera.most_slope);
    i.r0 = camera.focal.x * i.inverse_z * (i.m[0] - i.clamped.x * i.m[2]);
    i.r1 = camera.focal.y * i.inverse_z * (i.m[1] - i.clamped.y * i.m[2]);
    return i;
}

// (mean - camera)/|...| and 1/|...|; +z and 0 where the camera is at the mean.
fn towards(camera: Camera, mean: vec3f) -> vec4f {
    let offset = mean - camera.position;
    let norm2 = dot(offset, offset);
    if norm2 >= SAFE_SQUARE_LEAST && norm2 <= SAFE_SQUARE_MOST {
        let inverse = 1.0 / sqrt(norm2);
        return vec4f(offset * inverse, inverse);
    }
    let largest = max(max(abs(offset.x), abs(offset.y)), abs(offset.z));
    if largest == 0.0 {
        return vec4f(0.0, 0.0, 1.0, 0.0);
    }
    let scaled = offset / largest;
    let inverse = 1.0 / length(scaled);
    return vec4f(scaled * inverse, inverse / largest);
}

// Y_k(d); unspecified above the evaluated degree.
fn basis(d: vec3f) -> array<f32, 16> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    return array<f32, 16>(
        SH_C0,
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        SH_C2[0] * (x * y),
        SH_C2[1] * (y * z),
        SH_C2[2] * (2.0 * zz - xx - yy),
        SH_C2[3] * (x * z),
        SH_C2[4] * (xx - yy),
        SH_C3[0] * y * (3.0 * xx - yy),
        SH_C3[1] * (x * y) * z,
        SH_C3[2] * y * (4.0 * zz - xx - yy),
        SH_C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        SH_C3[4] * x * (4.0 * zz - xx - yy),
        SH_C3[5] * z * (xx - yy),
        SH_C3[6] * x * (xx - 3.0 * yy),
    );
}
