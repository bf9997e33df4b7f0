//! Cameras of the scene in world space (glTF 2.0, section 3.10). Scale of the node is ignored, as the specification
//! says.

use super::Camera;
use super::Projection;
use super::nodes::Walk;
use super::schema::CameraEntry;
use super::schema::Root;
use crate::base::Warning;
use glam::DMat4;

/// All cameras of the scene, in document order, also of invisible nodes. Those that cannot be used are
/// left out, but keep their number: `render --camera` counts what one sees in the document.
pub(super) fn read(root: &Root, walk: &Walk, warnings: &mut Vec<Warning>) -> Vec<Camera> {
    let mut cameras = Vec::new();
    let with_camera = walk.placed.iter().filter_map(|placed| Some((placed, root.nodes[placed.node].camera?)));
    for (number, (placed, index)) in with_camera.enumerate() {
        let name = root.node_name(placed.node);
        let camera = root.cameras.get(index).and_then(projection).zip(unscaled(walk.worlds[placed.node]));
        match camera {
            Some((projection, world)) => {
                cameras.push(Camera { number, name, world_from_camera: world.as_mat4(), projection });
            }
            None => {
                let what = format!("the camera of node {name} is missing or has no usable lens; it was left out");
                warnings.push(Warning::new("bad-camera", what).at(name));
            }
        }
    }
    cameras
}

fn projection(entry: &CameraEntry) -> Option<Projection> {
    let usable = |v: f32| v.is_finite() && v != 0.0;
    if let Some(lens) = &entry.perspective {
        let yfov = lens.yfov;
        let aspect = lens.aspect_ratio.filter(|a| a.is_finite() && *a > 0.0);
        return (yfov > 0.0 && yfov < core::f32::consts::PI).then_some(Projection::Perspective { yfov, aspect });
    }
    let lens = entry.orthographic.as_ref()?;
    let usable = usable(lens.xmag) && usable(lens.ymag);
    usable.then_some(Projection::Orthographic { xmag: lens.xmag.abs(), ymag: lens.ymag.abs() })
}

/// The rigid part of a transform: z kept, x made perpendicular to it, y completes a right-handed frame.
fn unscaled(world: DMat4) -> Option<DMat4> {
    let z = world.z_axis.truncate().try_normalize()?;
    // A mirrored node shows a mirrored picture with x kept; y then follows from the right hand, so up is taken as
    // given.
    let y = world.y_axis.truncate();
    let y = (y - z * y.dot(z)).try_normalize()?;
    Some(DMat4::from_cols(y.cross(z).extend(0.0), y.extend(0.0), z.extend(0.0), world.w_axis))
}
