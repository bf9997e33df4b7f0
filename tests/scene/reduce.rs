//! Images that serve diffuse reflectance alone, scaled down to what a lightmap can tell.

use super::*;

const SIDE: u32 = 64;

/// A square of two metres for each material, which shows a whole picture.
fn squares(materials: impl Fn(&mut Builder) -> Vec<Value>) -> Builder {
    let mut b = Builder::new();
    let position = b.floats("VEC3", &[0., 0., 0., 2., 0., 0., 2., 0., 2., 0., 0., 2.]);
    let uv = b.floats("VEC2", &[0., 0., 1., 0., 1., 1., 0., 1.]);
    let corners: Vec<u8> = [0u16, 2, 1, 0, 3, 2].iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = b.accessor(5123, "SCALAR", 6, &corners, json!({}));
    let attributes = json!({"POSITION": position, "TEXCOORD_0": uv});
    let made = materials(&mut b);
    for material in made {
        let material = b.push("materials", material);
        let primitive = json!({"attributes": attributes, "indices": indices, "material": material});
        let mesh = b.push("meshes", json!({"primitives": [primitive]}));
        b.push("nodes", json!({"mesh": mesh}));
    }
    b
}

/// Noise, the same on every run.
fn noise(b: &mut Builder) -> usize {
    let byte = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
    let pixels: Vec<[u8; 4]> = (0..SIDE * SIDE).map(|i| [byte(i), byte(i + 7), byte(i + 77), byte(i + 777)]).collect();
    b.texture(SIDE, &pixels)
}

fn sides(scene: &Scene) -> Vec<u32> {
    scene.textures.iter().map(|t| t.width).collect()
}

fn loaded(b: &Builder, texels_per_meter: f32) -> Scene {
    let settings = Settings { albedo_density: Some(texels_per_meter), ..NONE };
    scene::load_bytes(b.glb(&[]), Path::new("a.glb"), &settings).unwrap().output
}

#[test]
fn only_what_serves_reflectance_alone_is_scaled_down() {
    let b = squares(|b| {
        let texture: Vec<usize> = (0..8).map(|_| noise(b)).collect();
        let base = |k: usize| json!({"baseColorTexture": {"index": texture[k]}});
        vec![
            json!({"pbrMetallicRoughness": base(0)}),
            json!({"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": texture[1]}}}),
            json!({"pbrMetallicRoughness": base(2), "alphaMode": "MASK"}),
            json!({"pbrMetallicRoughness": base(3), "alphaMode": "BLEND"}),
            json!({"emissiveTexture": {"index": texture[4]}, "emissiveFactor": [1, 1, 1]}),
            // One material reflects by it, another one glows by it.
            json!({"pbrMetallicRoughness": base(5)}),
            json!({"emissiveTexture": {"index": texture[5]}, "emissiveFactor": [1, 1, 1]}),
            // A colour here, a number there.
            json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture[6]}, "metallicRoughnessTexture": {"index": texture[6]}}}),
            // Two hundred of it on two metres: one pixel is a texel's sixteenth.
            json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture[7], "extensions": {"KHR_texture_transform": {"scale": [0.1, 0.1]}}}}}),
        ]
    });
    // Four texels on two metres: both sides together take 8 of 64 pixels, and half a quarter of a pixel is left to halve.
    assert_eq!(sides(&loaded(&b, 2.0)), [32, 32, 64, 64, 64, 64, 64, 64]);
    assert_eq!(sides(&loaded(&b, 0.5)), [8, 8, 64, 64, 64, 64, 64, 64]);
    assert_eq!(sides(&loaded(&b, 8.0)), [64; 8]);
    assert_eq!(sides(&load_with(&b, &NONE).output), [64; 8]);
}

#[test]
fn a_texel_reflects_what_the_mean_of_its_pixels_does() {
    let b = squares(|b| {
        vec![json!({"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": {"index": noise(b)}}})]
    });
    let (fine, coarse) = (loaded(&b, 1e4), loaded(&b, 2.0));
    assert_eq!((sides(&fine), sides(&coarse)), (vec![SIDE], vec![SIDE / 2]));
    // Means of squares of 16 pixels, a texel, by looks at each pixel of either picture.
    let mean = |scene: &Scene, texel: [u32; 2]| {
        let side = scene.textures[0].width;
        let looks = side / 4;
        let look = |k: u32| {
            let pixel = [k % looks, k / looks];
            let at = [0, 1].map(|i| ((texel[i] * looks + pixel[i]) as f32 + 0.5) / side as f32);
            scene.textures[0].sample_srgb(Vec2::from(at)).truncate()
        };
        (0..looks * looks).map(look).sum::<Vec3>() / (looks * looks) as f32
    };
    for texel in (0..16).map(|k| [k % 4, k / 4]) {
        let (fine, coarse) = (mean(&fine, texel), mean(&coarse, texel));
        // Codes are rounded, up or down: 0.0045 at most for one pixel, of which there are 64.
        assert!((fine - coarse).abs().max_element() < 0.001, "{texel:?}: {fine} {coarse}");
    }
}
