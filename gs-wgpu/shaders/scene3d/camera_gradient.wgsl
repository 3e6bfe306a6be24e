// After `project_bwd_3d`: sums the gradients by the camera of its work groups into the status. One
// work group.

#import scene3d/camera_sum: CameraGradient, of_camera_row, plus, sum_of_group
#import shared: EllipsoidGradient, Status, step

@group(0) @binding(1) var<storage, read> gradients: array<EllipsoidGradient>;
@group(0) @binding(2) var<storage, read_write> status: Status;

@compute @workgroup_size(64)
fn camera_gradient_3d(@builtin(local_invocation_index) lane: u32) {
    var sum: CameraGradient;
    let end = step.gaussians + (step.gaussians + 63u) / 64u;
    for (var row = step.gaussians + lane; row < end; row += 64u) {
        sum = plus(sum, of_camera_row(gradients[row]));
    }
    sum = sum_of_group(lane, sum);
    if lane == 0u {
        let v = sum.translation;
        let w = sum.rotation;
        status.by_camera = array<f32, 10>(v.x, v.y, v.z, w.x, w.y, w.z, sum.focal.x, sum.focal.y, sum.center.x, sum.center.y);
    }
}
