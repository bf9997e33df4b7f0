//! Materials, textures and lights.

use super::*;

/// A square with a 2 × 2 texture whose texels are told apart by their red value: 0 1 / 2 3 from the top.
pub(crate) fn textured(info: Value, sampler: Value) -> Builder {
    let mut info = info;
    info["index"] = json!(0);
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": info, "metallicFactor": 0}}));
    let red = |v: u8| [v, 0, 0, 255];
    b.texture(2, &[red(0), red(85), red(170), red(255)]);
    let sampler = b.push("samplers", sampler);
    b.set("/textures/0/sampler", json!(sampler));
    b
}

/// Which texel (0 to 3) is seen at a point of the square.
fn texel(scene: &Scene, x: f32, y: f32) -> u32 {
    let (triangle, b) = if y <= x { (0, Vec2::new(x - y, y)) } else { (1, Vec2::new(x, y - x)) };
    let red = scene.reflectance(triangle, b).x;
    (0..4).min_by_key(|&i| ((red - srgb(i)).abs() * 1e6) as u32).unwrap()
}

fn srgb(texel: u32) -> f32 {
    texelwalk::base::color::srgb_to_linear(texel as f32 / 3.0)
}

#[test]
fn texture_transform_turns_as_the_example_of_its_specification() {
    let nearest = json!({"magFilter": 9728});
    let plain = load(&textured(json!({}), nearest.clone()));
    // TEXCOORD_0 = (x, y), so y grows towards the bottom row of the image.
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&plain, x, y)), [0, 1, 2, 3]);
    // "Utilizes only the lower left quadrant of the source image, rotated clockwise 90°."
    let transform = json!({"offset": [0, 1], "rotation": core::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5]});
    let quadrant = json!({"extensions": {"KHR_texture_transform": transform}});
    let scene = load(&textured(quadrant, nearest.clone()));
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&scene, x, y)), [2; 4]);
    // The same turn of the whole image: u' = v, v' = 1 − u.
    let transform = json!({"offset": [0, 1], "rotation": core::f32::consts::FRAC_PI_2});
    let turned = load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), nearest.clone()));
    assert_eq!([(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| texel(&turned, x, y)), [2, 0, 3, 1]);
    // Scale comes before rotation: u' = 3·v·sin = 0.6 (not 2·v).
    let transform = json!({"rotation": core::f32::consts::FRAC_PI_2, "scale": [2, 3]});
    let scene = load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), nearest));
    let map = scene.materials[0].base_color_texture.unwrap().transform;
    assert!((map.transform_point2(Vec2::new(0.1, 0.2)) - Vec2::new(0.6, -0.2)).length() < 1e-6);
}

#[test]
fn samplers_reach_the_texture() {
    let at = |wrap: u32, x: f32| {
        let transform = json!({"offset": [1, 0]});
        let sampler = json!({"magFilter": 9728, "wrapS": wrap});
        texel(&load(&textured(json!({"extensions": {"KHR_texture_transform": transform}}), sampler)), x, 0.2)
    };
    assert_eq!([10_497, 33_648, 33_071].map(|wrap| (at(wrap, 0.2), at(wrap, 0.8))), [(0, 1), (1, 0), (1, 1)]);
    let filtered = load(&textured(json!({}), json!({"magFilter": 9729, "wrapS": 33_071})));
    let middle = filtered.reflectance(0, Vec2::new(0.25, 0.25)).x;
    assert!((middle - (srgb(0) + srgb(1)) / 2.0).abs() < 1e-6, "bilinear on linear values");
    assert_eq!(codes(&textured(json!({}), json!({"wrapT": 5}))), ["bad-sampler"]);
}

#[test]
fn texture_coordinate_sets() {
    let mut b = textured(
        json!({"texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 3}}}),
        json!({"magFilter": 9728}),
    );
    let uv = b.floats("VEC2", &[0.75; 8]);
    b.set("/meshes/0/primitives/0/attributes/TEXCOORD_3", json!(uv));
    let scene = load(&b);
    assert_eq!(scene.materials[0].base_color_texture.unwrap().uv_set, 3);
    assert_eq!(scene.vertices.uv.len(), 4);
    assert_eq!(texel(&scene, 0.1, 0.05), 3);
    b.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_3");
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings[0].code, "missing-texcoord");
    assert_eq!(texel(&loaded.output, 0.9, 0.8), 0);
}

#[test]
fn vertex_colours_of_every_type_multiply_the_base_colour() {
    let expected = [Vec4::new(1., 0., 0.2, 1.), Vec4::new(0.2, 1., 0., 1.), Vec4::new(0., 0.2, 1., 0.4)];
    for (component, components) in [(5126, 3), (5126, 4), (5121, 3), (5121, 4), (5123, 3), (5123, 4)] {
        let mut b = Builder::triangle();
        let values: Vec<f32> = expected.iter().flat_map(|c| c.to_array()[..components].to_vec()).collect();
        let bytes: Vec<u8> = match component {
            5126 => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            5121 => values.iter().map(|v| (v * 255.0).round() as u8).collect(),
            _ => values.iter().flat_map(|v| ((v * 65535.0).round() as u16).to_le_bytes()).collect(),
        };
        let more = json!({"normalized": component != 5126});
        let color = b.accessor(component, ["VEC3", "VEC4"][components - 3], 3, &bytes, more);
        b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color));
        b.push(
            "materials",
            json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.5], "metallicFactor": 0.5}}),
        );
        b.set("/meshes/0/primitives/0/material", json!(0));
        let scene = load(&b);
        for (color, mut expected) in scene.vertices.color.iter().zip(expected) {
            expected.w = if components == 3 { 1.0 } else { expected.w };
            assert!((*color - expected).abs().max_element() < 1e-6, "{component} {components}");
        }
        assert!(near(scene.reflectance(0, Vec2::ZERO), Vec3::new(0.25, 0.0, 0.05)));
    }
}

#[test]
fn metallic_emission_alpha_and_sides() {
    let mut b = Builder::square(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.6, 0.4, 1], "metallicFactor": 0.5,
                                 "metallicRoughnessTexture": {"index": 0}},
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 1},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 20}},
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true
    }));
    b.texture(1, &[[255, 255, 51, 255]]);
    b.texture(1, &[[188, 188, 188, 255]]);
    let scene = load(&b);
    let at = Vec2::splat(0.3);
    assert!(near(scene.reflectance(0, at), Vec3::new(0.8, 0.6, 0.4) * 0.9));
    let texel = texelwalk::base::color::srgb_to_linear(188.0 / 255.0);
    assert!((scene.emission(0, at) - Vec3::new(20., 10., 0.) * texel).length() < 1e-4);
    assert!(scene.materials[0].double_sided);
    assert_eq!(scene.materials[0].alpha, Alpha::Mask(0.25));
    let default = &scene.materials[1];
    assert_eq!((default.metallic, default.base_color, default.alpha), (1.0, Vec4::ONE, Alpha::Opaque));
}

#[test]
fn lit_surface_without_a_material_is_told() {
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    let bare = json!({"attributes": {"POSITION": 0}, "indices": 2});
    let mesh = b.push("meshes", json!({"primitives": [bare, bare]}));
    let node = b.push("nodes", json!({"mesh": mesh, "name": "Bare", "extras": {"texelwalk": {"receives": false}}}));
    assert_eq!(load(&b).missing_materials(), None);
    b.set(&format!("/nodes/{node}/extras"), json!({}));
    let warning = load(&b).missing_materials().unwrap();
    assert_eq!((warning.code, warning.node.as_deref()), ("no-material", Some("Bare")));
    assert!(warning.message.starts_with("Bare, primitive 0 and 1 more primitives have"), "{}", warning.message);
}

#[test]
fn metal_that_nobody_asked_for_is_told() {
    let told = |material: Value| {
        let mut material = material;
        material["name"] = json!("Paint");
        load(&Builder::square(material)).metals_by_default().collect::<Vec<_>>()
    };
    for bare in
        [json!({}), json!({"pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.5, 0.4, 1], "roughnessFactor": 0.9}})]
    {
        let found = told(bare);
        assert_eq!((found.len(), found[0].code, found[0].node.as_deref()), (1, "metal-by-default", Some("node 0")));
        assert!(found[0].message.starts_with("material Paint of node 0 "), "{}", found[0].message);
    }
    for said in [
        json!({"pbrMetallicRoughness": {"metallicFactor": 1}}),
        json!({"pbrMetallicRoughness": {"metallicFactor": 0}}),
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}}),
        json!({"extensions": {"KHR_materials_unlit": {}}}),
        json!({"emissiveFactor": [1, 1, 1]}),
    ] {
        assert_eq!(told(said.clone()), [], "{said}");
    }
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}));
    b.texture(1, &[[0, 0, 9, 255]]);
    assert_eq!(load(&b).metals_by_default().count(), 0);
    let mut b = Builder::square(json!({}));
    b.set("/nodes/0/extras", json!({"texelwalk": {"receives": false}}));
    assert_eq!(load(&b).metals_by_default().count(), 0);
}

#[test]
fn scenes_whose_surface_is_all_unlit_are_told() {
    let mut b = Builder::square(json!({"extensions": {"KHR_materials_unlit": {}}}));
    let warning = load(&b).nothing_lit().unwrap();
    assert_eq!(warning.code, "nothing-lit");
    assert!(warning.message.contains("1 of 1 primitives"), "{}", warning.message);
    // Not where none is wanted, and not where anything else is lit.
    b.set("/nodes/0/extras", json!({"texelwalk": {"receives": false}}));
    assert_eq!(load(&b).nothing_lit(), None);
    b.set("/nodes/0/extras", json!({}));
    let lit = json!({"attributes": {"POSITION": 0}, "indices": 2});
    let mesh = b.push("meshes", json!({"primitives": [lit]}));
    b.push("nodes", json!({"mesh": mesh}));
    assert_eq!(load(&b).nothing_lit(), None);
}

#[test]
fn alpha_is_factor_times_texture_times_vertex_colour() {
    let mut b = textured(json!({}), json!({"magFilter": 9728}));
    b.set("/materials/0/pbrMetallicRoughness/baseColorFactor", json!([1, 1, 1, 0.5]));
    b.set("/materials/0/alphaMode", json!("BLEND"));
    let color = b.floats("VEC4", &[1., 1., 1., 0.5].repeat(4));
    b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color));
    let mut scene = load(&b);
    let at = Vec2::new(0.1, 0.1);
    assert!((scene.opacity(0, at) - 0.25).abs() < 1e-6);
    assert_eq!(scene.opacity(0, at), scene.base_color(0, at).w);
    scene.materials[0].alpha = Alpha::Mask(0.25);
    assert_eq!(scene.opacity(0, at), 1.0);
    scene.materials[0].alpha = Alpha::Mask(0.2501);
    assert_eq!(scene.opacity(0, at), 0.0);
}

/// Alpha at the cutoff is opaque (glTF 2.0, section 3.9.4), at every point and by whatever factor it comes.
#[test]
fn alpha_that_is_the_cutoff_leaves_no_holes() {
    let at =
        |k: u32| Vec2::from_array(texelwalk::base::low_discrepancy::Sequence::new(7).point(k)[..2].try_into().unwrap());
    for cutoff in [0.25f32, 0.3, 0.5, 0.8, 1.0] {
        for (factor, vertex, texel) in [(cutoff, 1.0, 255), (1.0, cutoff, 255), (1.0, 1.0, (cutoff * 255.0) as u8)] {
            let mut b = textured(json!({}), json!({}));
            b.texture(3, &[[9, 99, 199, texel]; 9]);
            b.set("/materials/0/pbrMetallicRoughness/baseColorTexture/index", json!(1));
            b.set("/materials/0/pbrMetallicRoughness/baseColorFactor", json!([1, 1, 1, factor]));
            b.set("/materials/0/alphaMode", json!("MASK"));
            b.set("/materials/0/alphaCutoff", json!(if texel < 255 { f32::from(texel) / 255.0 } else { cutoff }));
            let color = b.floats("VEC4", &[1., 1., 1., vertex].repeat(4));
            b.set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color));
            let scene = load(&b);
            let point = |k| if at(k).element_sum() > 1.0 { Vec2::ONE - at(k) } else { at(k) };
            let holes = (0..4000).filter(|k| scene.opacity(k % 2, point(*k)) < 1.0).count();
            assert_eq!(holes, 0, "cutoff {cutoff}: {factor} × {vertex} × {texel}");
        }
    }
}

#[test]
fn unlit_materials_block_light_and_receive_none() {
    let mut b = Builder::square(json!({"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}}}));
    b.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let scene = load(&b);
    assert!(!scene.parts[0].receives && scene.materials[0].unlit);
    assert_eq!(scene.reflectance(0, Vec2::ZERO) + scene.emission(0, Vec2::ZERO), Vec3::ZERO);
    assert_eq!(scene.opacity(0, Vec2::ZERO), 1.0);
}

#[test]
fn lights_have_the_defaults_of_their_extension() {
    let mut b = Builder::triangle();
    b.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "directional"}, {"type": "point"}, {"type": "spot"},
        {"type": "spot", "color": [1, 0.5, 0.25], "intensity": 8, "range": 4,
         "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}, "extras": {"radius": 0.125}},
        {"type": "directional", "extras": {"angle": 0.01}}
    ]}});
    let light = |i: u32| json!({"KHR_lights_punctual": {"light": i}});
    let half = core::f64::consts::FRAC_1_SQRT_2;
    b.push("nodes", json!({"extensions": light(0), "scale": [-3, 2, 5]}));
    b.push("nodes", json!({"extensions": light(1), "translation": [1, 2, 3], "scale": [4, 4, 4]}));
    // A quarter turn about x takes −z to +y.
    b.push("nodes", json!({"extensions": light(2), "rotation": [half, 0, 0, half]}));
    b.push("nodes", json!({"translation": [0, 0, 9], "children": [5]}));
    b.push("nodes", json!({"extensions": light(3), "translation": [0, 1, 0]}));
    b.push("nodes", json!({"extensions": light(4)}));
    let scene = load(&b);
    let [
        Light::Sun { direction, illuminance, angle },
        Light::Point { position, intensity, range, radius },
        spot,
        aimed,
        sun,
    ] = scene.lights.as_slice()
    else {
        panic!("{:?}", scene.lights)
    };
    assert_eq!((*direction, *illuminance, *angle), (Vec3::NEG_Z, Vec3::ONE, 0.0));
    assert_eq!((*position, *intensity, *range, *radius), (Vec3::new(1., 2., 3.), Vec3::ONE, f32::INFINITY, 0.0));
    let Light::Spot { direction, cos_inner, cos_outer, .. } = spot else { panic!("{spot:?}") };
    assert!(near(*direction, Vec3::Y));
    assert!(*cos_inner == 1.0 && (cos_outer - half as f32).abs() < 1e-7);
    let Light::Spot { position, intensity, range, radius, cos_inner, cos_outer, .. } = aimed else {
        panic!("{aimed:?}")
    };
    assert_eq!((*position, *intensity), (Vec3::new(0., 1., 9.), Vec3::new(8., 4., 2.)));
    assert_eq!((*range, *radius), (4.0, 0.125));
    assert!((cos_inner - 0.980_066_6).abs() < 1e-6 && (cos_outer - 0.825_335_6).abs() < 1e-6);
    assert!(matches!(sun, Light::Sun { angle, .. } if *angle == 0.01));
    let suns = load_with(&b, &Settings { sun_angle: Some(0.5), ..NONE }).output.lights;
    assert!([&suns[0], &suns[4]].iter().all(|l| matches!(l, Light::Sun { angle, .. } if *angle == 0.5)));
}

#[test]
fn odd_lights_are_reported() {
    let mut b = Builder::triangle();
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": -5}, {"type": "tube"}, {"type": "spot", "spot": {"innerConeAngle": 3, "outerConeAngle": 2}},
        {"type": "point", "range": 0, "extras": {"radius": "big"}}, {"type": "spot", "spot": {"outerConeAngle": 0}},
        {"type": "directional", "extras": {"angle": 1.05}}
    ]}});
    for i in 0..6 {
        b.push("nodes", json!({"extensions": {"KHR_lights_punctual": {"light": i}}}));
    }
    let loaded = load_with(&b, &NONE);
    assert_eq!(loaded.warnings.len(), 7);
    assert!(loaded.warnings.iter().all(|w| w.code == "bad-light" && w.node.is_some()));
    let [Light::Spot { cos_inner, cos_outer, .. }, Light::Point { range, radius, .. }, Light::Sun { angle, .. }] =
        loaded.output.lights.as_slice()
    else {
        panic!("{:?}", loaded.output.lights)
    };
    assert!(cos_outer.abs() < 1e-6 && cos_inner == cos_outer);
    assert_eq!((*range, *radius, *angle), (f32::INFINITY, 0.0, 0.0));
}

#[test]
fn data_uris_16_bit_png_jpeg_and_webp() {
    let gray16 = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(2, 2, image::Luma([0x8080]));
    let rgb = image::RgbImage::from_pixel(8, 8, image::Rgb([128, 128, 128]));
    let encode = |image: image::DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let files = [
        encode(gray16.into(), image::ImageFormat::Png),
        encode(rgb.clone().into(), image::ImageFormat::Jpeg),
        encode(rgb.into(), image::ImageFormat::WebP),
    ];
    for (i, bytes) in files.iter().enumerate() {
        let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        b.push("images", json!({"uri": data_uri("image/whatever", bytes)}));
        match i {
            2 => b.push("textures", json!({"extensions": {"EXT_texture_webp": {"source": 0}}})),
            _ => b.push("textures", json!({"source": 0})),
        };
        let [r, _, _, a] = load(&b).textures[0].pixels[0];
        assert!(r.abs_diff(128) <= 1 && a == 255, "{i}: {r}");
    }
}
