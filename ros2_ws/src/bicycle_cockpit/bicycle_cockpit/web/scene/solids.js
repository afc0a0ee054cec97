// Tubes, rings and limbs: the parts that the bicycle and its rider are made of. z is up, as in the messages.

import * as THREE from "../vendor/three.module.min.js";

const UP = new THREE.Vector3(0, 1, 0);
const along = new THREE.Vector3();

export const vector = (x, y, z) => new THREE.Vector3(x, y, z);

/** Places a cylinder or capsule, made along y with length 1, between two points. */
export function stretch(mesh, from, to) {
  along.subVectors(to, from);
  const length = along.length() || 1e-6;
  mesh.position.copy(from).addScaledVector(along, 0.5);
  mesh.quaternion.setFromUnitVectors(UP, along.divideScalar(length));
  mesh.scale.set(1, length, 1);
  return mesh;
}

/** A round tube between two points; `second` is its radius at the end, m. */
export function tube(from, to, radius, material, second = radius, sides = 12) {
  const mesh = new THREE.Mesh(new THREE.CylinderGeometry(second, radius, 1, sides), material);
  mesh.castShadow = true;
  return stretch(mesh, from, to);
}

/** Thin rods without caps between pairs of points, as one mesh. */
export function rods(pairs, radius, material, sides = 4) {
  const [positions, normals, index] = [[], [], []];
  for (const [from, to] of pairs) {
    const line = to.clone().sub(from).normalize();
    const across = vector(line.y, line.z, line.x).cross(line).normalize();
    const other = line.clone().cross(across);
    const first = positions.length / 3;
    for (let side = 0; side < sides; side++) {
      const angle = (2 * Math.PI * side) / sides;
      const out = across.clone().multiplyScalar(Math.cos(angle)).addScaledVector(other, Math.sin(angle));
      for (const end of [from, to]) {
        positions.push(end.x + radius * out.x, end.y + radius * out.y, end.z + radius * out.z);
        normals.push(out.x, out.y, out.z);
      }
      const [here, next] = [first + 2 * side, first + 2 * ((side + 1) % sides)];
      index.push(here, next, here + 1, next, next + 1, here + 1);
    }
  }
  const geometry = new THREE.BufferGeometry().setIndex(index);
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.Float32BufferAttribute(normals, 3));
  return new THREE.Mesh(geometry, material);
}

export function ball(at, radius, material, stretched = [1, 1, 1]) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 18, 14), material);
  mesh.position.copy(at);
  mesh.scale.set(...stretched);
  mesh.castShadow = true;
  return mesh;
}

/** A ring about the y axis. */
export function ring(radius, thickness, material, sides = 8, parts = 56) {
  const geometry = new THREE.TorusGeometry(radius, thickness, sides, parts);
  geometry.rotateX(Math.PI / 2);
  const mesh = new THREE.Mesh(geometry, material);
  mesh.castShadow = true;
  return mesh;
}

/**
 * Parts that never move against each other, as one mesh for each material: a picture needs a call for each mesh.
 *
 * @param parts meshes, groups of them, in one system of coordinates
 */
export function merged(parts) {
  const byMaterial = new Map();
  for (const part of parts) {
    part.updateMatrixWorld(true);
    part.traverse(({ isMesh, geometry, material, matrixWorld }) => {
      if (!isMesh) return;
      if (!byMaterial.has(material)) byMaterial.set(material, []);
      byMaterial.get(material).push(geometry.applyMatrix4(matrixWorld));
    });
  }
  const group = new THREE.Group();
  for (const [material, geometries] of byMaterial) {
    const mesh = new THREE.Mesh(joined(geometries), material);
    mesh.castShadow = true;
    group.add(mesh);
  }
  return group;
}

function joined(geometries) {
  const total = (count) => geometries.reduce((sum, geometry) => sum + count(geometry), 0);
  const index = new Uint16Array(total((geometry) => geometry.index.count));
  const numbers = { position: null, normal: null };
  for (const name of Object.keys(numbers)) numbers[name] = new Float32Array(total(({ attributes }) => attributes[name].array.length));
  let [at, first] = [0, 0];
  for (const geometry of geometries) {
    for (const vertex of geometry.index.array) index[at++] = first + vertex;
    for (const name of Object.keys(numbers)) numbers[name].set(geometry.attributes[name].array, 3 * first);
    first += geometry.attributes.position.count;
  }
  const made = new THREE.BufferGeometry().setIndex(new THREE.BufferAttribute(index, 1));
  for (const [name, values] of Object.entries(numbers)) made.setAttribute(name, new THREE.BufferAttribute(values, 3));
  return made;
}

/**
 * The joint between two bones.
 *
 * @param from where the first bone begins @param to where the second ends
 * @param first length of the first, m @param second of the second
 * @param hint the direction in which the joint bends
 */
export function joint(from, to, first, second, hint) {
  const line = to.clone().sub(from);
  const apart = Math.min(line.length(), 0.999 * (first + second));
  line.normalize();
  const share = (apart * apart + first * first - second * second) / (2 * apart);
  const out = Math.sqrt(Math.max(0, first * first - share * share));
  const side = hint.clone().addScaledVector(line, -hint.dot(line)).normalize();
  return from.clone().addScaledVector(line, share).addScaledVector(side, out);
}
