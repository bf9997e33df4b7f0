/**
 * Charts and texels of a lightmap, drawn over the surfaces that use them.
 *
 * A chart is what triangles of a mesh connect, also across vertices at the same place with the same lightmap coordinates
 * (they differ in their normals). Every chart has a colour of its own; single texels show as a checkerboard, which fades
 * to its mean where a texel is smaller than two pixels. What has no lightmap is dark grey.
 */

import { BufferAttribute, ShaderMaterial, Vector2 } from 'three';

const VERTEX = `
attribute vec3 chartColor; attribute vec2 chartUv;
varying vec3 vColor; varying vec2 vTexel; varying vec3 vView;
uniform vec2 size;
void main() {
  vColor = chartColor;
  vTexel = chartUv * size;
  vec4 view = modelViewMatrix * vec4( position, 1.0 );
  vView = view.xyz;
  gl_Position = projectionMatrix * view;
}`;

const FRAGMENT = `
varying vec3 vColor; varying vec2 vTexel; varying vec3 vView;
uniform bool lit;
void main() {
  vec3 normal = normalize( cross( dFdx( vView ), dFdy( vView ) ) );
  float shade = 0.35 + 0.65 * abs( dot( normal, normalize( vView ) ) );
  vec2 width = fwidth( vTexel );
  float odd = mod( floor( vTexel.x ) + floor( vTexel.y ), 2.0 );
  float fine = smoothstep( 0.25, 0.5, max( width.x, width.y ) );
  vec3 color = lit ? vColor * mix( mix( 0.6, 1.0, odd ), 0.8, fine ) : vec3( 0.1 );
  gl_FragColor = vec4( color * shade, 1.0 );
  #include <colorspace_fragment>
}`;

/** A material that shows the charts of a mesh in place of its own; its geometry gets the attributes for it. */
export function chartMaterial(mesh, { lightMap, side }) {
  const size = new Vector2(1, 1);
  if (lightMap) {
    size.set(lightMap.image.width, lightMap.image.height);
    const { geometry } = mesh;
    const uv = geometry.attributes[lightMap.channel === 0 ? 'uv' : `uv${lightMap.channel}`];
    if (!geometry.attributes.chartColor) {
      geometry.setAttribute('chartUv', uv);
      geometry.setAttribute('chartColor', colors(geometry, uv, mesh.id));
    }
  }
  const uniforms = { size: { value: size }, lit: { value: Boolean(lightMap) } };
  return new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, side });
}

function colors(geometry, uv, seed) {
  const charts = chartOfVertices(geometry, uv);
  const out = new BufferAttribute(new Float32Array(charts.length * 3), 3);
  charts.forEach((chart, vertex) => out.setXYZ(vertex, ...color(chart + seed * 7919)));
  return out;
}

/** For every vertex the least vertex of its chart. */
export function chartOfVertices(geometry, uv) {
  const { position } = geometry.attributes;
  const parent = Array.from({ length: position.count }, (_, vertex) => vertex);
  const root = (vertex) => {
    while (parent[vertex] !== vertex) vertex = parent[vertex] = parent[parent[vertex]];
    return vertex;
  };
  const join = (a, b) => {
    const [x, y] = [root(a), root(b)];
    parent[Math.max(x, y)] = Math.min(x, y);
  };
  const places = new Map();
  for (let v = 0; v < position.count; v += 1) {
    const place = [position.getX(v), position.getY(v), position.getZ(v), uv.getX(v), uv.getY(v)].join();
    if (places.has(place)) join(v, places.get(place));
    else places.set(place, v);
  }
  const corner = geometry.index ? (i) => geometry.index.getX(i) : (i) => i;
  for (let i = 0; i + 2 < (geometry.index ?? position).count; i += 3) {
    join(corner(i), corner(i + 1));
    join(corner(i), corner(i + 2));
  }
  return parent.map((_, vertex) => root(vertex));
}

/** Hues a golden ratio apart, in three lightnesses. */
function color(number) {
  const hue = (number * 0.618034) % 1;
  const light = 0.35 + 0.2 * (number % 3);
  return [0, 2 / 3, 1 / 3].map((shift) => {
    const x = ((hue + shift) % 1) * 6;
    return light * (0.25 + 0.75 * Math.min(Math.max(Math.abs(x - 3) - 1, 0), 1));
  });
}
