//! Facts as tables for people.

use super::Facts;
use core::fmt::Write;

impl Facts {
    /// Tables for people.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self
            .write_parts(&mut out)
            .and_then(|()| self.write_light(&mut out))
            .and_then(|()| self.write_end(&mut out));
        out
    }

    fn write_parts(&self, out: &mut String) -> core::fmt::Result {
        writeln!(out, "{}", self.input)?;
        let head = ["triangles", "area m2", "texels", "charts"];
        let [triangles, area, texels, charts] = head;
        writeln!(out, "\n{:<28} {triangles:>10} {area:>10} {texels:>10} {charts:>7}  {:<8} material", "node", "uv")?;
        for p in &self.parts {
            let (notes, material) = (p.notes(), &p.material);
            writeln!(
                out,
                "{:<28} {:>10} {:>10.3} {:>10.0} {:>7}  {:<8} {material}{notes}",
                p.node, p.triangles, p.area, p.texels, p.charts, p.uv
            )?;
        }
        let (total, area) = ("in all", self.area);
        let texels = self.parts.iter().map(|p| p.texels).fold(0.0, |a, b| a + b);
        writeln!(out, "{total:<28} {:>10} {area:>10.3} {texels:>10.0} {:>7}", self.triangles, self.charts)?;
        let [x, y, z] = self.size;
        writeln!(out, "size: {x:.3} x {y:.3} x {z:.3} m")
    }

    fn write_light(&self, out: &mut String) -> core::fmt::Result {
        let triple = |v: [f32; 3]| format!("{:.3} {:.3} {:.3}", v[0], v[1], v[2]);
        writeln!(out, "\n{:<28} {:<20} {:<20} alpha", "material", "mean reflectance", "mean emission cd/m2")?;
        for m in &self.materials {
            let mut notes = m.alpha.to_owned();
            for (set, word) in [(m.double_sided, ", double-sided"), (m.unlit, ", unlit")] {
                notes += if set { word } else { "" };
            }
            writeln!(out, "{:<28} {:<20} {:<20} {notes}", m.name, triple(m.mean_reflectance), triple(m.mean_emission))?;
        }
        for l in &self.lights {
            writeln!(out, "light: {}", l.line())?;
        }
        for p in self.parts.iter().filter(|p| p.flux.iter().any(|f| *f > 0.0)) {
            let [r, g, b] = p.flux;
            writeln!(out, "light: {} emits {r:.3} {g:.3} {b:.3} lm", p.node)?;
        }
        for v in &self.variants {
            writeln!(out, "variant: {v}")?;
        }
        for (i, name) in self.cameras.iter().enumerate() {
            let name = name.as_deref().unwrap_or("cannot be used");
            writeln!(out, "camera {i}: {name}")?;
        }
        Ok(())
    }

    fn write_end(&self, out: &mut String) -> core::fmt::Result {
        let used = self.utilization * 100.0;
        let [width, height] = self.page_size;
        writeln!(
            out,
            "\n{} texels in {} charts on {} page(s) of {width}x{height} ({used:.0} % used) at {} texels/m",
            self.texels, self.charts, self.pages, self.texels_per_meter
        )?;
        writeln!(out, "memory of a bake: about {}", self.memory.words())?;
        writeln!(out, "time of a bake: {}", self.time.words())?;
        for w in &self.warnings {
            let node = w.node.as_ref().map_or(String::new(), |n| format!(" [{n}]"));
            writeln!(out, "warning: {}{node}: {}", w.code, w.message)?;
        }
        Ok(())
    }
}
