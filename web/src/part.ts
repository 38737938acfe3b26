// A solid seen in space: triangles of an STL file, shaded by their direction. Plain WebGL; nothing else is needed.
const VERTEX = `attribute vec3 at, normal; uniform mat3 turn; uniform vec3 centre; uniform vec2 scale; uniform float depth; varying vec3 n;
void main() { vec3 p = turn * (at - centre); n = turn * normal; gl_Position = vec4(p.xy * scale, -p.z * depth, 1.0); }`;
const FRAGMENT = `precision mediump float; varying vec3 n; uniform vec3 colour;
void main() { float light = 0.35 + 0.65 * abs(dot(normalize(n), normalize(vec3(0.3, 0.5, 0.8)))); gl_FragColor = vec4(colour * light, 1.0); }`;
const TURN: Record<string, [number, number]> = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };

// Corners and directions, three corners a triangle; RangeError where it is no binary STL.
export function triangles(data: ArrayBuffer): { at: Float32Array; normal: Float32Array } {
  const view = new DataView(data);
  const count = view.getUint32(80, true);
  if (data.byteLength < 84 + 50 * count) throw new RangeError("not a binary STL");
  const [at, normal] = [new Float32Array(9 * count), new Float32Array(9 * count)];
  for (let i = 0; i < count; i++)
    for (let j = 0; j < 9; j++) {
      at[9 * i + j] = view.getFloat32(84 + 50 * i + 12 + 4 * j, true);
      normal[9 * i + j] = view.getFloat32(84 + 50 * i + 4 * (j % 3), true);
    }
  return { at, normal };
}

export class Part {
  private gl: WebGLRenderingContext | null;
  private program!: WebGLProgram;
  private count: number;
  private centre = [0, 0, 0];
  private size = 1;
  private zoom = 1;
  private angles: [number, number] = [0.6, -1.05];
  private watch: ResizeObserver;

  constructor(private readonly canvas: HTMLCanvasElement, data: ArrayBuffer) {
    const { at, normal } = triangles(data);
    this.count = at.length / 3;
    for (let axis = 0; axis < 3; axis++) {
      let [low, high] = [Infinity, -Infinity];
      for (let i = axis; i < at.length; i += 3) [low, high] = [Math.min(low, at[i]), Math.max(high, at[i])];
      this.centre[axis] = (low + high) / 2;
      this.size = Math.max(this.size, high - low);
    }
    this.gl = canvas.getContext("webgl", { antialias: true });
    if (this.gl) this.load(this.gl, at, normal);
    else canvas.replaceWith("This browser has no WebGL: download the part from the files on the right.");
    this.hands();
    this.watch = new ResizeObserver(() => this.draw());
    this.watch.observe(canvas);
    canvas.dataset.triangles = String(this.count / 3);
  }

  end(): void {
    this.watch.disconnect();
  }

  private load(gl: WebGLRenderingContext, at: Float32Array, normal: Float32Array): void {
    this.program = gl.createProgram()!;
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
    for (const [name, values] of [["at", at], ["normal", normal]] as const) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      const place = gl.getAttribLocation(this.program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    }
    gl.enable(gl.DEPTH_TEST);
  }

  private hands(): void {
    const { canvas } = this;
    canvas.onpointerdown = (down) => {
      canvas.setPointerCapture(down.pointerId);
      let [x, y] = [down.clientX, down.clientY];
      canvas.onpointermove = (move) => {
        this.turn((move.clientX - x) * 0.01, (move.clientY - y) * 0.01);
        [x, y] = [move.clientX, move.clientY];
      };
    };
    canvas.onpointerup = canvas.onpointercancel = () => (canvas.onpointermove = null);
    canvas.onwheel = (event) => (event.preventDefault(), this.nearer(Math.exp(-event.deltaY * 0.0015)));
    canvas.onkeydown = (event) => {
      const by = TURN[event.key];
      const factor = { "+": 1.2, "=": 1.2, "-": 1 / 1.2 }[event.key];
      if (!by && !factor) return;
      event.preventDefault();
      if (by) this.turn(...by);
      else this.nearer(factor!);
    };
  }

  private turn(about: number, over: number): void {
    this.angles = [this.angles[0] + about, this.angles[1] + over];
    this.draw();
  }

  private nearer(factor: number): void {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.2), 20);
    this.draw();
  }

  private draw(): void {
    const { gl, canvas } = this;
    if (!gl || !canvas.clientWidth) return;
    [canvas.width, canvas.height] = [canvas.clientWidth * devicePixelRatio, canvas.clientHeight * devicePixelRatio];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [a, b] = this.angles;
    const [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
    // about the part's own z, then over the screen's x; columns one after the other
    const turn = [ca, sa * cb, sa * sb, -sa, ca * cb, ca * sb, 0, -sb, cb];
    const uniform = (name: string) => gl.getUniformLocation(this.program, name);
    const scale = (1.5 * this.zoom) / this.size;
    const narrow = Math.min(canvas.width, canvas.height);
    gl.uniformMatrix3fv(uniform("turn"), false, turn);
    gl.uniform3fv(uniform("centre"), this.centre);
    gl.uniform2f(uniform("scale"), (scale * narrow) / canvas.width, (scale * narrow) / canvas.height);
    gl.uniform1f(uniform("depth"), 0.5 / this.size);
    const ink = getComputedStyle(canvas).getPropertyValue("--accent").trim();
    const channel = (i: number) => parseInt(ink.slice(1 + 2 * i, 3 + 2 * i), 16) / 255;
    gl.uniform3f(uniform("colour"), channel(0), channel(1), channel(2));
    gl.drawArrays(gl.TRIANGLES, 0, this.count);
  }
}
