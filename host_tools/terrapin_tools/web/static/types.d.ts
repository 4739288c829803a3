// What the server sends and what the scripts hand each other. Only the type checker of `make check` reads this file.

// ---------------------------------------------------------------- the frame (app.js)

type App = typeof import('./app.js').app;
type Child = Node | string | null | undefined | false | (Node | string | null | undefined | false)[];
type Heard<E extends Event> = (event: E & { target: any }) => unknown;
type Properties = {
  onclick?: Heard<MouseEvent>; onchange?: Heard<Event>; oninput?: Heard<Event>; onsubmit?: Heard<SubmitEvent>;
  [attribute: string]: any;
};

/** What a tab's `mount` returns. */
interface Tab { show?(rest: string): void; hide?(): void; redraw?(): void }

/** A request: `body` is an object that goes as JSON, or a Blob that goes as it is. */
interface Asked { method?: string; body?: unknown; headers?: Record<string, string>; keepalive?: boolean; signal?: AbortSignal }

type JobState = 'queued' | 'running' | 'done' | 'failed' | 'cancelled';
interface Job {
  id: string; do: string; case: string | null; command: string; state: JobState; progress: string[]; result: any; error: string | null;
}
/** What is known of a job between two looks at it. */
type JobNews = Partial<Job> & { id: string };
/** `id` and the command line of a job that was started. */
interface Started { id: string; command: string }

/** An event of the server; `lost` and `back` are of the connection itself. */
interface News {
  lost?: true; back?: true; cases?: unknown; case?: string | null; deleted?: boolean; upload?: string; state?: string;
  job?: string; do?: string; line?: string; error?: string | null; live?: Stands | null;
}

// ---------------------------------------------------------------- the workbench

interface CaseSummary { name: string; title: string; base: string; effects: string[]; runs: number; rows: number; verdict: string | null; chip: string; error: string | null }
interface Example { name: string; title: string; about: string }
/** A small picture of a case. */
interface Thumbnail { x: { name: string; unit: string; values: number[] }; y: { name: string; unit: string }; measured: number[]; predicted: number[] }
interface Quantity { value: number; unit: string; sd?: number | null }

interface Rung { added: string | null; train_error: number; heldout_error: number | null }
interface PlotChannel { name: string; unit: string; noise_sd: number | null; measured: number[]; predicted: number[]; base: number[] | null }
interface Heat { edges: number[]; single: boolean; mean: Record<string, (number | null)[][]>; count: number[][] }
interface PlotData {
  variable: string; columns: Record<string, { values: number[]; unit: string }>; channels: PlotChannel[];
  run: number[]; runs: string[]; held: boolean[]; ladder: Rung[]; where: { variable: string; channel: string; range: number[] }[];
  heat: { runs: number[]; columns: Record<string, Heat> }; rows: number; kept: number;
}
/** A part of what a plot shows: from where to where on both axes. */
interface Zoomed { x: number[]; y: number[] }
/** The rows of such a part, of one channel: `rows` in it, of which `kept` are told. */
interface Refined { columns: PlotData['columns']; channel: Pick<PlotChannel, 'measured' | 'predicted' | 'base'>; run: number[]; rows: number; kept: number }
/** What a report draws: with the curves of `sets` added. */
interface ReportData extends PlotData { channels: (PlotChannel & { previews: number[][] })[]; sets: string[][]; by_run: string }
interface Card {
  effect: string; title: string; named: boolean; kind: string; probability: number; chance: string; equation: string; acts: string;
  reason: string; values: string[];
}
/** The formula of an effect of one's own. */
interface OwnFormula { expression: string; target: string; parameters: Record<string, Partial<Record<'value' | 'min' | 'max' | 'unit', number | string | null>>> }
interface InModel { effect: string; title: string; equation: string; values: string[]; own: OwnFormula | null }
interface ConstantLine { name: string; text: string; si: string; guessed: boolean }
interface Next { do: 'discover' | 'add' | 'experiment' | 'nothing'; text: string }
interface Experiment extends Next {
  vary: string[]; settings: string[][]; after: string; simulator: boolean;
}
/** The fitted model beside the measurements, not yet judged. */
interface Draft { title: string; base: string; effects: string[]; runs: number; held_out: string[]; plot: PlotData }
/** All that is drawn of a case. */
interface View extends Draft {
  verdict: string; chip: string; headline: string; where: { variable: string; channel: string; text: string }[];
  discovered: boolean; missing: string[]; rivals: string[][]; formulas: [string, string][]; model: InModel[]; constants: ConstantLine[]; cards: Card[]; next: Next & Partial<Experiment>;
  curve: string; heading: string; measure: string; by_run: string; remarks: string[]; front: { terms: number; name: string; training: string; held_out: string; probability: string; share: number }[]; chances: [string, string][]; errors: Record<string, string[]>;
  parameters: [string, string, string][];
  channels: Record<string, { noise_sd: number; train_rmse: number; heldout_rmse: number | null; unit: string }>;
  noise: string;
  history: { action: string; effects: string[]; before: { heldout_error: number }; after: { heldout_error: number } }[];
  notes: string; targets: { all: string[]; default: string }; names: string[]; catalogue: string[]; exports: string[];
}
/** What is drawn over a model: what another predicts on the same rows, in a colour of the style sheet. */
interface Extra { label: string; channels: Record<string, number[]>; color: string; band?: string }
/** What a case is held against: another model of it, or, with `plot`, another case; `error` says why the two share no axes. */
interface Other { title: string; channels: Record<string, number[]>; plot?: PlotData; error?: string; train: number | null; held: number | null; model: string }
/** What the model would do with `effects` added; only these until the server has answered. */
interface Preview { effects: string[]; channels?: Record<string, number[]>; train_error?: number; heldout_error?: number | null }
interface ExpressionAnswer { ok: boolean; message: string; mathml: string | null; names: string[]; unknown: string[] }
type CasePage = import('./case_page.js').CasePage;

// ---------------------------------------------------------------- measurements into a case

interface UploadColumn { name: string; numeric: boolean; preview: string[]; min: number | null; max: number | null; role_guess: string | null; unit_guess: string; name_guess: string }
interface Upload {
  id: string; name: string; kind: 'csv' | 'parquet' | 'log' | 'dbc'; rows: number; columns: UploadColumn[]; warnings: string[];
  base_guess: string | null; run_guess: string | null; draft: MapDraft | null;
}
/** What is typed into the form that maps columns. */
interface MapTyped {
  fields: Record<string, string>; constants: Record<string, string>;
  columns: { column: string; name?: string; unit: string; sigma: string }[];
}
interface MapDraft extends MapTyped { uploads: string[]; base: string }
/** What is mapped: tables or logs, the first of which shows its columns, and the DBC of logs. */
interface MapSource { bases: Base[]; data: Upload[]; dbc: Upload | undefined; first: Upload; suiting: Suiting | null }
/** The base model that a table suits best, and what is said of it and of others. */
interface Suiting { base: string; lines: string[] }
/** What happens when somebody changes the form. */
interface MapHeard { make(): void; discard(): void; later(): void; remodel(): void; look(show: (text: string) => void): void; reread(reading: Record<string, string>): void }
interface MapRow { column: UploadColumn; is: HTMLSelectElement | HTMLInputElement; unit: HTMLInputElement; sigma: HTMLInputElement; element: HTMLElement }
/** A mapped column: its name in formulas, its unit, and whether its heading says that it is the time. */
interface Mapped { name: string; unit: string; clock: boolean }
/** Differential equations of one's own, as POST /api/cases takes them. */
interface MapMotion {
  states: Record<string, { initial: number | string; unit: string }>; derivative: Record<string, string>; measured: Record<string, string>;
  fit: Record<string, { value: number; min?: number; max?: number; unit?: string }>; parameters: Record<string, number | string>;
}
interface Base {
  name: string; channels: { name: string; unit: string }[]; roles: { name: string; unit: string; needed: boolean }[];
  parameters: { name: string; unit: string; placeholder: string | null; default: number | null }[]; fit: string | null;
  own_names: boolean; own_dynamics: boolean; left_out: string[];
}

// ---------------------------------------------------------------- plots

type Pen = CanvasRenderingContext2D;
/** A value in its unit to a place on the canvas, in pixels. */
type Scale = (value: number) => number;
interface Axis { name: string; unit?: string }
interface Points { values: number[]; rows: number[]; kind: string; color: string; size?: number; alpha?: number }
interface Line { values: number[]; lines: number[][] | null; color: string; width: number; dash?: number[]; under?: boolean }
interface Band { values: number[]; lines: number[][] | null; half: number; color: string }
/** What a mark means. */
interface Key { text: string; mark: 'dot' | 'held' | 'line' | 'dashed' | 'box'; color: string }
interface PlotTable { columns: string[]; rows: (string | number)[][] }
interface PlotSpec {
  x: Axis & { values: number[]; chosen?: boolean }; y: Axis; points: Points[]; lines: Line[]; bands: Band[]; ranges: number[][];
  keys?: Key[]; level?: number[] | null; frame?: { x: number[]; y: number[] }; describe(row: number): string; table(): PlotTable; alt?: string;
}
/** Where a plot stands on its canvas [px], what it shows, and how a value becomes a place. */
interface PlotMap { box: { x0: number; x1: number; y0: number; y1: number }; xs: number[]; ys: number[]; X: Scale; Y: Scale; x: Scale; y: Scale }
/** Which axes of a plot are logarithmic. */
interface Logs { x: boolean; y: boolean }
/** A picture of the ladder: rungs that fall show an error on its way. */
interface Shown { train: number | null; held: number | null }

interface Column { x: number; first: number; low: number; high: number; last: number }
interface Bar { x: number; wide: number; low: number; high: number }
interface Lane {
  name: string; unit: string; words?: Record<number, string> | null; colour: string; ring: import('./strip.js').Ring;
  truth?: import('./strip.js').Ring | null; sd?: import('./strip.js').Ring | null; other?: import('./strip.js').Ring | null;
  valid?: import('./strip.js').Ring | null; // 0 where the signal is not valid
  places?: number | undefined; // decimals that it is worth, where neither sd nor prefix says so
}
interface Mark { time: number | null; kind: string; text: string; number?: number; wide?: number }

// ---------------------------------------------------------------- Live

interface Link { source: string; title: string; kind: 'bus' | 'log' | 'robot' | 'simulator' | 'dbc' }
interface Signal { name: string; unit: string; words?: Record<number, string> | null }
interface Hello {
  type: 'hello'; name: string | null; command?: string; stop?: '' | 'bus' | 'simulator'; slip_limit: number | null; radius?: number | null; speeds?: number | null; watch?: Watch | null;
  page?: string; kind?: 'bus' | 'robot' | 'simulator' | 'log'; drive?: Record<string, { unit: string; limit: number }> | null;
  signals?: { name: string; unit: string; words?: Record<string, number> | null }[];
}
interface Recording { name: string; frames: number; bytes: number; seconds: number }
interface Status {
  type: 'status'; state: 'live' | 'over' | 'gone'; note: string; begin: number; total: number; rate: number; load: number; health: string;
  silent: boolean; fit: string; errors: Record<string, number>; bus_off: number; counters: number[] | null; lost: number; damaged: number;
  faults: { name: string; cause: string; reaction: string; latched?: boolean }[]; values: (number | null)[]; unknown: [string, number][]; nodes: NodeLine[];
  recording: Recording | null; last_log: Recording | null; stop_held: boolean; events: (Mark & { number: number })[];
  drive: { driver: string; ended: string; leaving: boolean; sent: number; request: string; control: string; setpoint: number; limiter: boolean } | null;
  replay: { position: number; length: number | null; speed: number; loop: boolean } | null;
}
/** Whether what is watched can be stopped, is stopped, is driven. */
interface Stands { name: string; stop: string; held: boolean; driven: boolean }
interface ParameterLine { name: string; value: number; text: string; unit: string; low: number; high: number; default: number; meaning: string }
/** What is asked for with POST live. */
interface Watch { source: string; dbc: string; speed: number; bitrate: number; controller: string; node?: number }
/** A controller on the bus: state and faults in words, and signals by their names. */
interface NodeLine { node: number; watched: boolean; said: string; 'MOTION.slip': number | null; 'GROUND.torque': number | null; 'ELECTRICAL.current': number | null }
/** What the panels of the Live tab ask of the tab. */
interface LiveDesk { app: App; run<T>(action: () => Promise<T>): Promise<T | null>; tell(text: string): void }

// ---------------------------------------------------------------- Simulate

interface Bounds { name: string; unit: string; start: number; meaning: string; low: number; high: number }
interface EffectOffer { name: string; title: string; soil: boolean; parameters: Bounds[] }
interface FaultOffer { channels: string[]; unit: string; high: number | null }
interface Fault { kind: string; channel: string; value: number | null; begin: number; end: number | null }
interface Scenario {
  name: string; title: string; duration: number; seed: number; supply: number; soil: string | null; contact: boolean; checks: number;
  judged: string; fields: { name: string; value: string; example: string }[];
  ground: { from: number; slope: number; terrain: string }[]; effects: Record<string, Record<string, number>>; faults: Fault[];
  orders: { at: number; request: string; control: string; setpoint: number; limiter: boolean }[];
}
interface Scenarios { scenarios: Scenario[]; terrains: string[]; soils: string[]; effects: EffectOffer[]; faults: Record<string, FaultOffer> }
/** A scenario as the form has it now. */
interface Changes {
  ground: { terrain: string; slope: number }[]; setpoints: number[]; limiter: boolean; effects: Record<string, Record<string, number>>;
  faults: Fault[]; seed: number; duration: number; supply: number; soil: string | null;
}
interface RunLine { name: string; seed: number; complete: boolean; passed: boolean | null }
interface BatchLine { name: string; done: number; failed: number; runs: number; complete: boolean; report: boolean }
/** How far a batch is; a point is passed, seed, what was varied, as `inputs` names them; an outcome the run's number, why it failed, `results`. */
interface BatchState { name: string; done: number; failed: number; runs: number; complete: boolean; inputs: string[]; points: unknown[][]; results: string[]; outcomes: [number, string, ...(number | null)[]][] }
type Columns = Record<string, (number | null)[]> & { time: number[] };
/** A run: columns of equal length, SI units. */
interface Run {
  name: string; run: { title: string; complete: boolean }; checks: { passed: boolean; found: string; missed?: string }[]; radius: number;
  words: { state: Record<number, string> }; ground: { x: number[]; height: number[] }; segments: { from: number; terrain: string }[];
  faults: { text: string; begin: number; end: number | null }[]; columns: Columns;
  settings: Scenario | null; changes: string[]; course: string; judged: string;
}
