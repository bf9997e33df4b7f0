//! Images that serve diffuse reflectance alone, scaled down to what a lightmap can tell; what `inspect` says of them.

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

/// Steel, bright, that shows under dark paint here and there: base colour, metalness.
fn scratched() -> [Vec<[u8; 4]>; 2] {
    let is_steel = |i: u32| i.wrapping_mul(2_654_435_761) >> 29 == 0;
    let pixels = |steel: [u8; 4], paint: [u8; 4]| {
        (0..SIDE * SIDE).map(|i| if is_steel(i) { steel } else { paint }).collect::<Vec<_>>()
    };
    [pixels([240, 240, 240, 255], [60, 60, 60, 255]), pixels([0, 200, 255, 255], [0, 200, 0, 255])]
}

fn metallic(color: usize, metal: usize) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": color}, "metallicRoughnessTexture": {"index": metal}}})
}

/// Mean over the square of a material.
fn mean_reflectance(scene: &Scene, material: u32) -> f32 {
    let n = 2 * SIDE;
    let at = |k: u32| (k as f32 + 0.5) / n as f32;
    let lower = (0..n * n).map(|k| Vec2::new(at(k % n), at(k / n))).filter(|b| b.element_sum() <= 1.0);
    let looks: Vec<f32> =
        lower.flat_map(|b| [2 * material, 2 * material + 1].map(|t| scene.reflectance(t, b).x)).collect();
    looks.iter().sum::<f32>() / looks.len() as f32
}

/// The mean of a product is not the product of means: those would be 0.14 here.
#[test]
fn paint_with_scratches_reflects_the_same_at_any_density() {
    let specular = |color: usize, other: usize| {
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness":
            {"diffuseTexture": {"index": color}, "specularGlossinessTexture": {"index": other}}}})
    };
    let [color, metal] = scratched();
    let steel = color.iter().filter(|p| p[0] == 240).count() as f32 / color.len() as f32;
    let expected = texelwalk::base::color::srgb_to_linear(60.0 / 255.0) * (1.0 - steel);
    let b = squares(|b| {
        let [c, m] = [&color, &metal].map(|pixels| b.texture(SIDE, pixels));
        // What a mirror reflects of paint is black, of steel all.
        let mirror: Vec<_> = metal.iter().map(|p| [p[2], p[2], p[2], 255]).collect();
        let [d, s] = [&color, &mirror].map(|pixels| b.texture(SIDE, pixels));
        let [e, o] = [&color, &metal].map(|pixels| b.texture(SIDE, pixels));
        let mut blended = metallic(e, o);
        blended["alphaMode"] = json!("BLEND");
        vec![metallic(c, m), specular(d, s), blended]
    });
    for (density, side) in [(2.0, 32), (0.5, 8), (0.01, 1)] {
        let scene = loaded(&b, density);
        assert_eq!(sides(&scene), [side; 6], "{density}");
        for material in 0..3 {
            let found = mean_reflectance(&scene, material);
            assert!((found / expected - 1.0).abs() < 0.01, "{density}, {material}: {found} of {expected}");
            assert!(scene.materials[material as usize].metallic_texture.is_some() || material == 1);
        }
    }
    assert_eq!(sides(&loaded(&b, 8.0)), [SIDE; 6]);
}

#[test]
fn products_that_differ_keep_their_images() {
    let [color, metal] = scratched();
    let half: Vec<_> = (0..SIDE * SIDE / 4).map(|i| [0, 0, (i % 256) as u8, 255]).collect();
    let b = squares(|b| {
        let mut texture = |pixels: &[[u8; 4]], side: u32| b.texture(side, pixels);
        let [a, b2, c, d, e, f, g, h] = [0; 8].map(|_| texture(&color, SIDE));
        let small = texture(&half, SIDE / 2);
        let mut moved = metallic(a, b2);
        moved["pbrMetallicRoughness"]["metallicRoughnessTexture"]["extensions"] =
            json!({"KHR_texture_transform": {"offset": [0.5, 0]}});
        let mut other = metallic(f, g);
        other["pbrMetallicRoughness"]["metallicFactor"] = json!(0.5);
        let mut covered = metallic(h, small);
        covered["alphaMode"] = json!("MASK");
        // Another place of it, one colour with two metals, two factors; then another size.
        vec![moved, metallic(c, d), metallic(c, e), metallic(f, g), other, covered]
    });
    let found = loaded(&b, 0.5);
    assert_eq!(sides(&found), [64, 64, 64, 64, 64, 64, 64, 8, 8]);
    let expected = mean_reflectance(&loaded(&b, 1e4), 5);
    assert!((mean_reflectance(&found, 5) / expected - 1.0).abs() < 0.01);
    assert!(metal.len() == color.len());
}

#[test]
fn images_of_any_size_and_kind_are_scaled_down() {
    let pixel = |i: usize| if i % 5 < 2 { [230, 230, 230, 255] } else { [60, 60, 60, 255] };
    let pixels: Vec<[u8; 4]> = (0..50 * 50).map(pixel).collect();
    let encoded = |format: image::ImageFormat| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let all = image::RgbaImage::from_raw(50, 50, pixels.concat()).unwrap();
        image::DynamicImage::from(all).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let lit =
        |index: usize| json!({"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": {"index": index}}});
    let mut b = squares(|b| {
        let view = b.view(&encoded(image::ImageFormat::WebP), json!({}));
        b.push("images", json!({"bufferView": view}));
        b.push("images", json!({"uri": data_uri("image/png", &encoded(image::ImageFormat::Png))}));
        b.push("textures", json!({"extensions": {"EXT_texture_webp": {"source": 0}}}));
        b.push("textures", json!({"source": 1}));
        let [odd, blended] = [0; 2].map(|_| b.texture(50, &pixels));
        let mut blend = lit(blended);
        blend["alphaMode"] = json!("BLEND");
        vec![lit(0), lit(1), lit(odd), blend]
    });
    b.json["extensionsUsed"] = json!(["EXT_texture_webp"]);
    let scene = loaded(&b, 0.5);
    // A sixteenth of a metre is a pixel of 16 across; halved twice, 50 are 12.5.
    assert_eq!(sides(&scene), [13; 4]);
    let linear = texelwalk::base::color::srgb_to_linear;
    let expected = 0.4 * linear(230.0 / 255.0) + 0.6 * linear(60.0 / 255.0);
    for material in 0..4 {
        let found = mean_reflectance(&scene, material);
        assert!((found / expected - 1.0).abs() < 0.01, "{material}: {found} of {expected}");
    }
}

#[test]
fn inspect_tells_the_mean_of_the_product() {
    let [color, metal] = scratched();
    let steel = color.iter().filter(|p| p[0] == 240).count() as f32 / color.len() as f32;
    let srgb = |code: f32| texelwalk::base::color::srgb_to_linear(code / 255.0);
    let colors = srgb(60.0) * (1.0 - steel) + srgb(240.0) * steel;
    let b = squares(|b| {
        let [c, m, d, n] = [&color, &metal, &color, &metal].map(|pixels| b.texture(SIDE, pixels));
        let mut moved = metallic(d, n);
        moved["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
            json!({"KHR_texture_transform": {"offset": [0.5, 0]}});
        let mut nearest = vec![metallic(c, m), moved];
        nearest[0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5, 1, 1, 1]);
        b.push("samplers", json!({"magFilter": 9728}));
        for t in [c, m, d, n] {
            b.set(&format!("/textures/{t}/sampler"), json!(0));
        }
        nearest
    });
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.glb");
    std::fs::write(&input, b.glb(&[])).unwrap();
    let paint = srgb(60.0) * (1.0 - steel);
    // All pixels, and a few that are means of products.
    for density in ["64", "2"] {
        let options = texelwalk::settings::Options::from_toml(&format!("texels-per-meter = {density}")).unwrap();
        let facts = texelwalk::inspect::inspect(&input, &options.settings().unwrap()).unwrap();
        for (material, expected) in facts.materials.iter().zip([paint, colors * (1.0 - steel)]) {
            let found = material.mean_reflectance[1];
            assert!((found / expected - 1.0).abs() < 0.03, "{density}: {found} of {expected}");
        }
        let half = facts.materials[0].mean_reflectance[0] / facts.materials[0].mean_reflectance[1];
        assert!((half - 0.5).abs() < 1e-5, "{half}");
    }
}
