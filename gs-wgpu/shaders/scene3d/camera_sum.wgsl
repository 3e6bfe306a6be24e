// Sums of gradients by the camera over a work group of 64.

#import shared: EllipsoidGradient

// As gs-core's `CameraGradient`.
struct CameraGradient {
    translation: vec3f,
    rotation: vec3f,
    focal: vec2f,
    center: vec2f,
}

var<workgroup> of_lanes: array<CameraGradient, 64>;

fn plus(a: CameraGradient, b: CameraGradient) -> CameraGradient {
    return CameraGradient(
        a.translation + b.translation, a.rotation + b.rotation, a.focal + b.focal, a.center + b.center,
    );
}

// The sum over all lanes, in lane 0.
fn sum_of_group(lane: u32, value: CameraGradient) -> CameraGradient {
    of_lanes[lane] = value;
    workgroupBarrier();
    for (var half = 32u; half > 0u; half /= 2u) {
        if lane < half {
            of_lanes[lane] = plus(of_lanes[lane], of_lanes[lane + half]);
        }
        workgroupBarrier();
    }
    return of_lanes[0];
}

// A sum as a row of gradients, and back.
fn camera_row(sum: CameraGradient) -> EllipsoidGradient {
    var row: EllipsoidGradient;
    row.mean = sum.translation;
    row.log_scale = sum.rotation;
    row.rotation = vec4f(sum.focal, sum.center);
    return row;
}

fn of_camera_row(row: EllipsoidGradient) -> CameraGradient {
    return CameraGradient(row.mean, row.log_scale, row.rotation.xy, row.rotation.zw);
}
