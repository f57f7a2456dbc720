// Plays poses of bodies that were computed before. The data is made by jaxsim/viz/page.py: a JSON record with
// numbers in one block of base64, little-endian float32. World axes are MuJoCo's, z up.
(() => {
  "use strict";
  const element = (id) => document.getElementById(id);
  const data = JSON.parse(element("data").textContent);
  const numbers = decode(data.numbers);
  const times = slice(data.times);
  const T = times.length, duration = T > 1 ? times[T - 1] - times[0] : 0;

  function decode(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Float32Array(bytes.buffer);
  }
  function slice([start, length]) { return numbers.subarray(start, start + length); }

  // ---- scene
  const canvas = element("view");
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    element("trouble").hidden = false;
    element("trouble").textContent = "This browser has no WebGL, which the picture needs: " + error.message;
    return;
  }
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xdfe8f2);
  scene.add(new THREE.HemisphereLight(0xffffff, 0xb9b4a8, 2.0));
  const size = data.extent;
  scene.fog = new THREE.Fog(0xdfe8f2, 25 * size, 60 * size);
  const sun = new THREE.DirectionalLight(0xffffff, 2.2);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  Object.assign(sun.shadow.camera, { left: -6 * size, right: 6 * size, top: 6 * size, bottom: -6 * size, near: 0.1 * size, far: 40 * size });
  sun.shadow.normalBias = 0.01 * size;
  scene.add(sun, sun.target);

  const camera = new THREE.PerspectiveCamera(45, 1, 0.01 * size, 200 * size);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableDamping = true;
  controls.dampingFactor = 0.15;

  // ---- shapes
  function checker() {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 64;
    const pen = tile.getContext("2d");
    pen.fillStyle = "#e9ebee"; pen.fillRect(0, 0, 64, 64);
    pen.fillStyle = "#cfd4da"; pen.fillRect(0, 0, 32, 32); pen.fillRect(32, 32, 32, 32);
    const texture = new THREE.CanvasTexture(tile);
    texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.anisotropy = 8;
    return texture;
  }
  const alongZ = (geometry) => geometry.rotateX(Math.PI / 2);
  function surface(points, faces) {
    const geometry = new THREE.BufferGeometry();
    const corners = new Float32Array(faces.length * 3);  // not shared: flat faces look flat
    for (let i = 0; i < faces.length; i++) corners.set(points.subarray(3 * faces[i], 3 * faces[i] + 3), 3 * i);
    geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
    geometry.computeVertexNormals();
    return geometry;
  }
  const surfaces = data.surfaces.map((s) => surface(slice(s.points), slice(s.faces)));
  const shapes = {
    plane: ([x, y]) => new THREE.PlaneGeometry(2 * (x || 100 * size), 2 * (y || 100 * size)),
    sphere: ([r]) => new THREE.SphereGeometry(r, 32, 20),
    capsule: ([r, h]) => alongZ(new THREE.CapsuleGeometry(r, 2 * h, 10, 24)),
    ellipsoid: ([x, y, z]) => new THREE.SphereGeometry(1, 32, 20).scale(x, y, z),
    cylinder: ([r, h]) => alongZ(new THREE.CylinderGeometry(r, r, 2 * h, 32)),
    box: ([x, y, z]) => new THREE.BoxGeometry(2 * x, 2 * y, 2 * z),
    surface: (_, geom) => surfaces[geom.surface],
  };
  const made = data.geoms.map((geom) => {
    const geometry = shapes[geom.type](geom.size, geom);
    const [r, g, b, a] = geom.rgba;
    const look = { color: new THREE.Color().setRGB(r, g, b, THREE.SRGBColorSpace), roughness: 0.6, metalness: 0.0 };
    if (a < 1) Object.assign(look, { transparent: true, opacity: a });
    if (geom.type === "plane") {
      look.map = checker();
      const [x, y] = geom.size, unit = 2 * data.tile;
      look.map.repeat.set(2 * (x || 100 * size) / unit, 2 * (y || 100 * size) / unit);
      look.side = THREE.DoubleSide;
    }
    return { geom, geometry, material: new THREE.MeshStandardMaterial(look) };
  });

  // One group of objects for each environment; what does not move is drawn once if environments stand at one place.
  function robot(poses, ghost) {
    const moving = data.moving.map(() => new THREE.Group()), fixed = new THREE.Group(), whole = new THREE.Group();
    whole.add(fixed, ...moving);
    for (const { geom, geometry, material } of made) {
      if (ghost && geom.slot < 0) continue;
      let look = material;
      if (ghost) { look = material.clone(); Object.assign(look, { transparent: true, opacity: 0.3, depthWrite: false }); }
      const mesh = new THREE.Mesh(geometry, look);
      mesh.position.set(...geom.pos);
      mesh.quaternion.set(...geom.quat);
      mesh.castShadow = !ghost && geom.type !== "plane";
      mesh.receiveShadow = !ghost;
      (geom.slot < 0 ? fixed : moving[geom.slot]).add(mesh);
    }
    scene.add(whole);
    return { moving, fixed, whole, poses };
  }
  const robots = data.poses.map((range, i) => {
    const one = robot(slice(range), false);
    one.whole.position.set(...data.places[i]);
    // A plane without end serves all.
    if (i > 0) one.fixed.children.forEach((mesh, k) => { if (mesh.geometry.type === "PlaneGeometry") mesh.visible = false; });
    return one;
  });
  const ghosts = data.ghosts.map((range, i) => {
    const one = robot(slice(range), true);
    one.whole.position.set(...data.places[i]);
    return one;
  });

  // ---- marks: centres of mass, contacts
  const marks = { com: new THREE.Group(), contacts: new THREE.Group(), ghost: null };
  scene.add(marks.com, marks.contacts);
  const red = new THREE.MeshBasicMaterial({ color: 0xd03030, depthTest: false, transparent: true });
  const coms = data.com.map((range) => {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.04 * size, 16, 12), red);
    ball.renderOrder = 2;
    marks.com.add(ball);
    return { ball, path: slice(range) };
  });
  const most = Math.max(1, ...data.contacts.map((c) => c.most));
  function copies(geometry, color) {
    const mesh = new THREE.InstancedMesh(geometry, new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true }), most * Math.max(1, data.contacts.length));
    mesh.frustumCulled = false;
    mesh.renderOrder = 1;
    mesh.count = 0;
    marks.contacts.add(mesh);
    return mesh;
  }
  const points = copies(new THREE.SphereGeometry(0.018 * size, 12, 8), 0xe08a00);
  const shafts = copies(new THREE.CylinderGeometry(0.008 * size, 0.008 * size, 1, 8).translate(0, 0.5, 0), 0x1f9d55);
  const heads = copies(new THREE.CylinderGeometry(0, 0.022 * size, 0.05 * size, 10).translate(0, 0.025 * size, 0), 0x1f9d55);
  const touching = data.contacts.map((c) => ({ first: slice(c.first), rows: slice(c.rows) }));

  // ---- a frame
  const up = new THREE.Vector3(0, 1, 0), vector = new THREE.Vector3(), turn = new THREE.Quaternion(), other = new THREE.Quaternion();
  const matrix = new THREE.Matrix4(), ones = new THREE.Vector3(1, 1, 1), place = new THREE.Vector3();
  function pose(body, poses, n, slot, f, w) {
    const a = 7 * (f * n + slot), b = 7 * (Math.min(f + 1, T - 1) * n + slot);
    const mix = (k) => poses[a + k] + w * (poses[b + k] - poses[a + k]);
    body.position.set(mix(0), mix(1), mix(2));
    turn.set(poses[a + 3], poses[a + 4], poses[a + 5], poses[a + 6]);
    other.set(poses[b + 3], poses[b + 4], poses[b + 5], poses[b + 6]);
    body.quaternion.slerpQuaternions(turn, other, w);
  }
  function show(time) {
    let low = 0, high = T - 1;  // the last frame that is not after this time
    while (low < high) { const m = (low + high + 1) >> 1; if (times[m] <= times[0] + time) low = m; else high = m - 1; }
    const f = low, step = f + 1 < T ? times[f + 1] - times[f] : 0;
    const w = step > 0 ? Math.min(1, Math.max(0, (times[0] + time - times[f]) / step)) : 0;
    for (const set of [robots, ghosts]) for (const r of set) r.moving.forEach((body, slot) => pose(body, r.poses, r.moving.length, slot, f, w));
    coms.forEach(({ ball, path }, i) => {
      const g = Math.min(f + 1, T - 1), mix = (k) => path[3 * f + k] + w * (path[3 * g + k] - path[3 * f + k]);
      ball.position.set(mix(0), mix(1), mix(2)).add(place.set(...data.places[i]));
    });
    let n = 0;
    touching.forEach(({ first, rows }, i) => {
      for (let c = first[f]; c < first[f + 1]; c++) {
        const row = rows.subarray(6 * c, 6 * c + 6), length = Math.min(Math.hypot(row[3], row[4], row[5]) * data.force, 1.5 * size);
        place.set(row[0] + data.places[i][0], row[1] + data.places[i][1], row[2] + data.places[i][2]);
        points.setMatrixAt(n, matrix.makeTranslation(place.x, place.y, place.z));
        turn.setFromUnitVectors(up, length > 0 ? vector.set(row[3], row[4], row[5]).normalize() : up);
        shafts.setMatrixAt(n, matrix.compose(place, turn, ones.set(1, Math.max(length, 1e-9), 1)));
        place.addScaledVector(vector, length);
        const head = length > 0.02 * size ? 1 : 0;
        heads.setMatrixAt(n, matrix.compose(place, turn, ones.set(head, head, head)));
        n++;
      }
    });
    for (const mesh of [points, shafts, heads]) { mesh.count = n; mesh.instanceMatrix.needsUpdate = true; }
    return f;
  }

  // ---- plot
  const plot = element("plot"), colors = ["#1f6fb2", "#d9541e", "#2e9e44", "#8a4fbf", "#b8860b", "#444"];
  const lines = data.series.flatMap((s) => {
    const values = slice(s.values), k = values.length / T;
    return Array.from({ length: k }, (_, j) => ({ name: k > 1 ? `${s.name}[${j}]` : s.name, at: (f) => values[f * k + j] }));
  });
  function draw(frame) {
    if (!lines.length) return;
    plot.hidden = false;
    const ratio = window.devicePixelRatio || 1, W = plot.clientWidth, H = plot.clientHeight;
    if (plot.width !== Math.round(W * ratio)) { plot.width = Math.round(W * ratio); plot.height = Math.round(H * ratio); }
    const pen = plot.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, W, H);
    let low = Infinity, high = -Infinity;
    for (const line of lines) for (let f = 0; f < T; f++) { const v = line.at(f); if (isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } }
    if (!(high > low)) { low -= 1; high += 1; }
    const x = (f) => 46 + (W - 54) * (T > 1 ? (times[f] - times[0]) / duration : 0.5), y = (v) => H - 12 - (H - 24) * (v - low) / (high - low);
    pen.font = "11px system-ui, sans-serif"; pen.fillStyle = "#556"; pen.textAlign = "right";
    pen.fillText(low.toPrecision(3), 42, H - 9); pen.fillText(high.toPrecision(3), 42, 16);
    lines.forEach((line, i) => {
      pen.strokeStyle = colors[i % colors.length]; pen.lineWidth = 1.4; pen.beginPath();
      for (let f = 0; f < T; f++) pen.lineTo(x(f), y(line.at(f)));
      pen.stroke();
      pen.fillStyle = pen.strokeStyle; pen.textAlign = "left";
      pen.fillText(`${line.name} ${line.at(frame).toPrecision(4)}`, 50 + (i % 2) * (W - 60) / 2, 14 + 13 * (i >> 1));
      pen.beginPath(); pen.arc(x(frame), y(line.at(frame)), 3, 0, 7); pen.fill();
    });
    pen.strokeStyle = "#0008"; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(x(frame), 6); pen.lineTo(x(frame), H - 6); pen.stroke();
  }
  function scrubPlot(event) {
    if (event.buttons !== 1) return;
    const u = (event.offsetX - 46) / (plot.clientWidth - 54);
    seek(duration * Math.min(1, Math.max(0, u)));
  }
  plot.addEventListener("pointerdown", scrubPlot);
  plot.addEventListener("pointermove", scrubPlot);

  // ---- controls
  const play = element("play"), scrub = element("scrub"), clock = element("clock"), speed = element("speed");
  scrub.max = duration || 1;
  let now = 0, playing = T > 1, before = null, dirty = true;
  function seek(time) { now = time; playing = false; dirty = true; }
  scrub.addEventListener("input", () => seek(Number(scrub.value)));
  const toggle = () => { playing = !playing && T > 1; if (playing && now >= duration) now = 0; };
  play.addEventListener("click", toggle);
  document.addEventListener("keydown", (event) => {
    const step = duration / Math.max(1, T - 1);
    if (event.key === " ") toggle();
    else if (event.key === "ArrowRight") seek(Math.min(duration, now + step));
    else if (event.key === "ArrowLeft") seek(Math.max(0, now - step));
    else return;
    event.preventDefault();
  });
  function checkbox(name, on, change) {
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = on; box.id = `show-${name}`;
    box.addEventListener("change", () => { change(box.checked); dirty = true; });
    label.append(box, ` ${name}`);
    element("toggles").append(label);
    change(on);
  }
  let following = data.follow;
  if (data.moving.length) checkbox("follow", following, (on) => { following = on; });
  if (coms.length) checkbox("com", false, (on) => { marks.com.visible = on; });
  if (touching.length) checkbox("contacts", true, (on) => { marks.contacts.visible = on; });
  if (ghosts.length) checkbox("ghost", true, (on) => { ghosts.forEach((g) => { g.whole.visible = on; }); });

  // ---- camera: MuJoCo's free camera, by azimuth and elevation
  const radians = Math.PI / 180, look = data.camera;
  controls.target.set(...look.target);
  const flat = Math.cos(look.elevation * radians), forward = new THREE.Vector3(
    flat * Math.cos(look.azimuth * radians), flat * Math.sin(look.azimuth * radians), Math.sin(look.elevation * radians));
  camera.position.copy(controls.target).addScaledVector(forward, -look.distance);
  const last = new THREE.Vector3(), here = new THREE.Vector3();
  const followed = () => here.copy(robots[0].moving[0].position).add(robots[0].whole.position);
  function follow() {
    if (!robots[0].moving.length) return;
    followed();
    if (following) { const d = place.subVectors(here, last); d.z = 0; camera.position.add(d); controls.target.add(d); }
    last.copy(here);
  }
  function resize() {
    const w = window.innerWidth, h = window.innerHeight;
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    renderer.setSize(w, h, false);
    camera.aspect = w / h;
    camera.updateProjectionMatrix();
    dirty = true;
  }
  window.addEventListener("resize", resize);
  controls.addEventListener("change", () => { dirty = true; });

  let frame = show(0);
  if (robots[0].moving.length) last.copy(followed());
  resize();
  const frames = { count: 0, slowest: 0, total: 0 };
  const TRIED = 30, SLOW = 25;  // frames, and milliseconds of each
  function render() {
    frame = show(now);
    follow();
    sun.target.position.copy(controls.target);
    sun.position.copy(controls.target).add(place.set(-4 * size, -6 * size, 12 * size));
    renderer.render(scene, camera);
    draw(frame);
    scrub.value = now;
    clock.textContent = `${(times[0] + now).toFixed(3)} s   ${frame + 1} / ${T}`;
    play.innerHTML = playing ? "&#10074;&#10074;" : "&#9654;";
    dirty = false;
  }
  function tick(stamp) {
    if (before !== null && playing) {
      frames.count++;
      frames.slowest = Math.max(frames.slowest, stamp - before);
      frames.total += stamp - before;
      // Without a graphics card, shadows take a third of the time.
      if (frames.count === TRIED && frames.total > SLOW * TRIED) sun.castShadow = false;
      now += Number(speed.value) * (stamp - before) / 1000;
      if (now > duration) now = 0;
      dirty = true;
    }
    before = stamp;
    controls.update();
    if (dirty) render();
    requestAnimationFrame(tick);
  }
  requestAnimationFrame(tick);

  // For tests, and for whoever embeds the page.
  window.jaxsim = {
    seek(time) { seek(time); render(); },
    position(env, slot) { render(); return robots[env].moving[slot].getWorldPosition(new THREE.Vector3()).toArray(); },
    frames,
    camera,
    controls,
  };
})();
