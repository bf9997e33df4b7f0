//! Environment maps by OpenEXR: where a layer lies on the sphere, and what a picture that is none is told.

use texelwalk::base::Rgb;
use texelwalk::scene::Environment;

#[test]
fn the_display_window_of_an_exr_is_the_sphere() {
    use exr::math::Vec2 as Place;
    use exr::prelude::{Image, IntegerBounds, Layer, LayerAttributes, SpecificChannels, WritableImage};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.exr");
    let write = |from: [i32; 2], to: [i32; 2], window: (usize, usize)| {
        let pixel = |at: Place<usize>| ((at.x() + 1) as f32, (at.y() + 1) as f32, 1.0);
        let attributes = LayerAttributes { layer_position: Place(from[0], from[1]), ..LayerAttributes::default() };
        let layer =
            Layer::new((4, 3), attributes, exr::prelude::Encoding::SMALL_LOSSLESS, SpecificChannels::rgb(pixel));
        let mut image = Image::from_layer(layer);
        image.attributes.display_window = IntegerBounds::new(Place(to[0], to[1]), window);
        image.write().to_file(&path).unwrap();
        Environment::load(&path, 1.0, 0.0)
    };
    // (offset of the layer from the window)
    for (from, to) in [([2, 1], [0, 0]), ([-5, 3], [-7, 2]), ([-1, -1], [0, 0]), ([6, 3], [0, 0]), ([0, 0], [0, 0])] {
        let map = write(from, to, (8, 4)).unwrap().output;
        assert_eq!(map.size(), [8, 4]);
        for (y, x) in (0..4).flat_map(|y| (0..8).map(move |x| (y, x))) {
            let [u, v] = [x as i32 + to[0] - from[0], y as i32 + to[1] - from[1]];
            let is_there = (0..4).contains(&u) && (0..3).contains(&v);
            let expected = if is_there { Rgb::new((u + 1) as f32, (v + 1) as f32, 1.0) } else { Rgb::ZERO };
            assert_eq!(map.pixel(x, y), expected, "{x}, {y} of {from:?} in {to:?}");
        }
    }
    assert_eq!(write([3, 3], [3, 3], (4, 3)).unwrap().output.pixel(3, 2), Rgb::new(4.0, 3.0, 1.0));
    for window in [(1 << 20, 1 << 20), (8192, 4096)] {
        let error = write([0, 0], [0, 0], window).unwrap_err().to_string();
        assert!(error.contains(&format!("{} × {}", window.0, window.1)), "{error}");
    }
}

#[test]
fn a_picture_of_several_layers_is_told_what_it_needs() {
    use exr::prelude::{SpecificChannels, WritableImage};
    let path = tempfile::tempdir().unwrap().path().with_extension("exr");
    let channels = SpecificChannels::build().with_channel("View.Combined.B").with_channel("View.Combined.G");
    let channels = channels.with_channel("View.Combined.R").with_pixel_fn(|_| (1.0f32, 1.0f32, 1.0f32));
    exr::prelude::Image::from_channels((8, 4), channels).write().to_file(&path).unwrap();
    let error = Environment::load(&path, 1.0, 0.0).unwrap_err().to_string();
    std::fs::remove_file(&path).unwrap();
    assert!(error.contains("R, G and B, or Y alone") && error.contains("View.Combined.R"), "{error}");
}
