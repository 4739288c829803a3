// The Simulate tab: a scenario with changes, run as a job; the robot rolling; the run kept as a case.
import { Robot, at } from './robot.js';
import { COLOURS, Ring, Strip, style } from './strip.js';

const DEGREE = Math.PI / 180;
const CHARTS = [
  ['slip', 'slip', '1'], ['contact_torque', 'contact torque C_t (truth)', 'N m'], ['estimate', 'C_t by the controller', 'N m'],
  ['swing_angle', 'swing angle', 'rad'], ['speed', 'speed', 'm/s'], ['sinkage', 'sinkage', 'm'], ['current', 'current', 'A'],
];

export function mount(element, app) {
  const { h, api, number, unit } = app;
  style();
  let description = null, scenario = null, changes = null, job = null, run = null, shown = false;
  let playing = false, time = 0, before = 0;

  // ---------------------------------------------------------------- the page
  const select = h('select', { id: 'sim-scenario', onchange: () => choose(select.value) });
  const title = h('p', { class: 'soft small' });
  const form = h('div', { class: 'sim-form' });
  const start = h('button', { type: 'button', class: 'main', text: 'Run', onclick: go });
  const reset = h('button', { type: 'button', text: 'As shipped', onclick: () => choose(select.value) });
  const link = h('select', { 'aria-label': 'Where the controller runs' }, h('option', { value: 'inprocess', text: 'controller in this process' }), h('option', { value: 'pty', text: 'controller as a process, over a pty' }));
  const bar = h('div', { class: 'job', hidden: true });
  const line = h('span', { class: 'line' });
  const progress = h('progress', { max: '100', value: 0, 'aria-label': 'Progress' });
  const cancel = h('button', { type: 'button', text: 'Cancel', onclick: () => job && attempt(() => app.cancel(job)) });
  bar.append(progress, line, cancel);
  const notice = h('p', { class: 'notice bad', role: 'alert', hidden: true });
  const name = h('h2', { text: 'The robot' });
  const place = h('div');
  const robot = new Robot(place);
  const play = h('button', { type: 'button', text: 'Play', onclick: () => setPlaying(!playing) });
  const pace = h('select', { 'aria-label': 'Pace' }, ...[0.1, 0.25, 0.5, 1, 2, 5].map((p) => h('option', { value: String(p), text: `${p} ×`, selected: p === 1 })));
  const scrub = h('input', { type: 'range', min: '0', max: '1', step: '0.01', value: '0', 'aria-label': 'Moment', disabled: true, oninput: () => { time = Number(scrub.value); setPlaying(false); draw(); } });
  const clock = h('output', { class: 'n', text: '–' });
  const facts = h('p', { class: 'small soft', 'aria-live': 'off' });
  const charts = h('div');
  charts.style.height = '150px';
  const strip = new Strip(charts);
  strip.empty = 'Slip, torque, swing and more, once there is a run.';
  strip.onPick = (picked) => { if (run) { time = picked; setPlaying(false); draw(); } };
  const checks = h('ul', { class: 'checks' });
  const checksTitle = h('h2', { text: 'Checks' });
  const keepName = h('input', { type: 'text', id: 'sim-keep', 'aria-label': 'Name of the case', maxlength: '64' });
  const keep = h('button', { type: 'button', text: 'Keep as a case', disabled: true, onclick: keepCase });
  const keepNote = h('p', { class: 'small soft', text: 'A case needs two runs, as one is held out: tick others above, or the scenario is run once more with the next seed.' });
  const runs = h('div', { class: 'runs', tabindex: '0', role: 'region', 'aria-label': 'Runs' });

  element.append(
    h('div', { class: 'sim-grid' },
      h('section', { class: 'panel sim-form' },
        h('div', { class: 'panel-head' }, h('h2', { text: 'Scenario' })),
        h('label', { for: 'sim-scenario', class: 'visually-hidden', text: 'Scenario' }), select, title,
        h('div', { class: 'row' }, start, reset), link, form),
      h('div', { class: 'plots' },
        notice, bar,
        h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, name),
          place, h('div', { class: 'play' }, play, pace, scrub, clock), facts),
        h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'What it did' })), charts),
        h('div', { class: 'below' },
          h('section', { class: 'panel' }, checksTitle, checks),
          h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Runs' })), runs,
            h('div', { class: 'record-row' }, keepName, keep), keepNote)))));

  async function attempt(action) {
    try { notice.hidden = true; return await action(); } catch (error) { notice.hidden = false; notice.textContent = error.message; return null; }
  }

  // ---------------------------------------------------------------- what can be changed

  async function load() {
    description = await attempt(() => api('scenarios'));
    if (!description) return;
    select.replaceChildren(...description.scenarios.map((s) => h('option', { value: s.name, text: s.title || s.name })));
    select.value = 'steady_sand';
    choose(select.value);
  }

  function choose(wanted) {
    scenario = description.scenarios.find((s) => s.name === wanted);
    changes = { ground: scenario.ground.map((g) => ({ terrain: g.terrain, slope: g.slope })), setpoints: scenario.orders.map((o) => o.setpoint),
      limiter: scenario.orders.some((o) => o.limiter), effects: structuredClone(scenario.effects), faults: structuredClone(scenario.faults),
      seed: scenario.seed, duration: scenario.duration, supply: scenario.supply, soil: scenario.soil };
    title.textContent = `${scenario.name}: ${scenario.duration} s, ${scenario.checks} checks`;
    fields();
  }

  function slider(text, low, high, value, step, unitText, change, factor = 1) {
    const out = h('output', { class: 'n' }), say = (v) => { out.textContent = `${number(v, 3)}${unit(unitText)}`; };
    const input = h('input', { type: 'range', min: String(low), max: String(high), step: String(step), value: String(value / factor), 'aria-label': text, oninput: () => { say(Number(input.value)); change(Number(input.value) * factor); command(); } });
    say(value / factor);
    return h('div', { class: 'slider' }, h('span', { text }), out, input);
  }
  const options = (list, value, change, label) => {
    const box = h('select', { 'aria-label': label, onchange: () => { change(box.value); command(); } }, ...list.map((o) => h('option', { value: o, text: o.replaceAll('_', ' '), selected: o === value })));
    return box;
  };
  const group = (text, ...children) => h('fieldset', {}, h('legend', { text }), ...children);

  function fields() {
    const parts = [];
    const ground = scenario.ground.flatMap((g, i) => {
      const where = scenario.ground.length > 1 ? ` from ${number(g.from)} m` : '';
      const slope = slider(`slope${where}`, -20, 20, changes.ground[i].slope, 0.5, '°', (v) => { changes.ground[i].slope = v; }, DEGREE);
      return scenario.contact ? [slope] : [h('div', { class: 'row' }, h('span', { class: 'small grow', text: `ground${where}` }), options(description.terrains, g.terrain, (v) => { changes.ground[i].terrain = v; }, `Ground${where}`)), slope];
    });
    if (scenario.soil) ground.unshift(h('div', { class: 'row' }, h('span', { class: 'small grow', text: 'soil' }), options(description.soils, scenario.soil, (v) => { changes.soil = v; }, 'Soil')));
    parts.push(group('Ground', ...ground));
    const orders = scenario.orders.map((o, i) => (o.request !== 'run' ? null : slider(`${o.control} from ${number(o.at)} s`, o.control === 'speed' ? -1.5 : -12, o.control === 'speed' ? 1.5 : 12, o.setpoint, o.control === 'speed' ? 0.01 : 0.1, o.control === 'speed' ? 'm/s' : 'V', (v) => { changes.setpoints[i] = v; }))).filter(Boolean);
    const limiter = h('input', { type: 'checkbox', id: 'sim-limiter', checked: changes.limiter, onchange: () => { changes.limiter = limiter.checked; command(); } });
    parts.push(group('Operator', ...orders,
      h('div', { class: 'row' }, limiter, h('label', { for: 'sim-limiter', text: 'slip limiter' })),
      slider('supply', 0, 20, changes.supply, 0.1, 'V', (v) => { changes.supply = v; }),
      slider('duration', 1, Math.max(60, scenario.duration), changes.duration, 1, 's', (v) => { changes.duration = v; }),
      slider('seed', 0, 50, changes.seed, 1, '', (v) => { changes.seed = v; })));
    parts.push(group('Effects', ...Object.entries(changes.effects).flatMap(([effect, values]) => effectFields(effect, values)), add('Add an effect …', description.effects.filter((e) => !(e.name in changes.effects) && (!e.soil || scenario.contact)).map((e) => [e.name, e.title]), addEffect)));
    parts.push(group('Faults', ...changes.faults.flatMap((fault, i) => faultFields(fault, i)), add('Add a fault …', Object.keys(description.faults).map((k) => [k, k.replaceAll('_', ' ')]), addFault)));
    form.replaceChildren(...parts);
    command();
  }

  function add(text, list, change) {
    const box = h('select', { 'aria-label': text, onchange: () => { if (box.value) { change(box.value); fields(); } } }, h('option', { value: '', text }), ...list.map(([value, shownText]) => h('option', { value, text: shownText })));
    return h('div', { class: 'row part-head' }, box);
  }
  function addEffect(wanted) {
    const effect = description.effects.find((e) => e.name === wanted);
    changes.effects[wanted] = Object.fromEntries(effect.parameters.map((p, i) => [p.name, i ? p.start : Number((p.low < 0 && p.high <= 0 ? p.low / 4 : p.high / 4).toPrecision(2))]));
  }
  function effectFields(wanted, values) {
    const effect = description.effects.find((e) => e.name === wanted);
    return [partHead(effect.title, () => { delete changes.effects[wanted]; }),
      ...effect.parameters.map((p) => slider(`${p.name}: ${p.meaning}`, p.low, p.high, values[p.name] ?? p.start, (p.high - p.low) / 200, p.unit, (v) => { values[p.name] = Number(v.toPrecision(6)); }))];
  }
  function addFault(kind) {
    const { channels, high } = description.faults[kind];
    changes.faults.push({ kind, channel: channels[0] || '', value: high === null ? 0 : high / 2, begin: Math.round(changes.duration / 3), end: null });
  }
  function faultFields(fault, i) {
    const { channels, unit: unitText, high } = description.faults[fault.kind];
    const end = changes.duration;
    return [partHead(fault.kind.replaceAll('_', ' '), () => { changes.faults.splice(i, 1); }),
      ...(channels.length ? [options(channels, fault.channel, (v) => { fault.channel = v; }, 'Channel')] : []),
      ...(high !== null ? [slider('value', 0, high, fault.value, high / 200, unitText, (v) => { fault.value = v; })] : []),
      slider('from', 0, end, fault.begin, 0.1, 's', (v) => { fault.begin = v; }),
      slider('to', 0, end, fault.end ?? end, 0.1, 's', (v) => { fault.end = v >= end ? null : v; })];
  }
  const partHead = (text, remove) => h('div', { class: 'part-head' }, h('b', { text }), h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${text}`, onclick: () => { remove(); fields(); } }));

  /** Only what differs from the scenario as shipped. */
  function body() {
    const found = { scenario: scenario.name, link: link.value };
    const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
    for (const key of ['duration', 'supply', 'soil', 'seed']) if (changes[key] !== scenario[key]) found[key] = changes[key];
    const ground = changes.ground.map((g, i) => ({ ...(g.terrain !== scenario.ground[i].terrain ? { terrain: g.terrain } : {}), ...(Math.abs(g.slope - scenario.ground[i].slope) > 1e-9 ? { slope: g.slope } : {}) }));
    if (ground.some((g) => Object.keys(g).length)) found.ground = ground;
    if (!same(changes.setpoints, scenario.orders.map((o) => o.setpoint))) found.setpoints = changes.setpoints.map((s, i) => (s === scenario.orders[i].setpoint ? null : s));
    if (changes.limiter !== scenario.orders.some((o) => o.limiter)) found.limiter = changes.limiter;
    if (!same(changes.effects, scenario.effects)) found.effects = changes.effects;
    if (!same(changes.faults, scenario.faults)) found.faults = changes.faults.map((f) => ({ ...f, value: description.faults[f.kind].high === null ? null : f.value }));
    return found;
  }
  function command() {
    const changed = Object.keys(body()).some((key) => !['scenario', 'link', 'seed'].includes(key));
    reset.disabled = !changed && changes.seed === scenario.seed;
    if (shown) app.showCommand(`terrapin run ${changed ? 'the scenario with these changes' : scenario.name}${link.value === 'pty' ? ' --link pty' : ''}${changes.seed !== scenario.seed ? ` --seed ${changes.seed}` : ''}`);
  }
  link.addEventListener('change', command);

  // ---------------------------------------------------------------- running

  async function go() {
    start.disabled = true;
    const started = await attempt(() => api('simulate', { body: body() }));
    start.disabled = false;
    if (started) { app.showCommand(started.command); await watch(started.id, started.run); }
  }

  async function watch(id, wanted) {
    job = id;
    bar.hidden = false;
    start.disabled = true;
    progress.removeAttribute('value');
    line.textContent = 'waiting';
    const ended = await attempt(() => app.follow(id, (now) => {
      const last = now.progress[now.progress.length - 1] || now.state;
      line.textContent = last;
      const share = /(\d+) %/.exec(last);
      if (share) progress.value = Number(share[1]);
    }));
    job = null;
    bar.hidden = true;
    start.disabled = false;
    await list();
    if (!ended) return null;
    if (ended.state === 'failed') { notice.hidden = false; notice.textContent = ended.error; return null; }
    if (ended.state === 'cancelled') app.announce('cancelled');
    if (ended.state === 'done') app.announce('the run is done');
    if (wanted) await open(wanted, ended.state === 'done');
    return ended;
  }

  // ---------------------------------------------------------------- a run

  async function open(wanted, roll = true) {
    const found = await attempt(() => api(`simulate/${encodeURIComponent(wanted)}/signals`));
    if (!found) return;
    run = found;
    const { columns } = run, { time: times } = columns;
    robot.show(run);
    name.textContent = `${run.name}${run.run.title ? `: ${run.run.title}` : ''}${run.run.complete ? '' : ' (cut short)'}`;
    time = times[0];
    Object.assign(scrub, { min: String(times[0]), max: String(times[times.length - 1]), value: String(time), disabled: false });
    strip.lanes = CHARTS.filter(([key]) => columns[key] && columns[key].some((v) => v)).slice(0, 6).map(([key, text, unitText], i) => {
      const ring = new Ring();
      columns[key].forEach((v, row) => { if (v !== null) ring.push(times[row], v); });
      return { name: text, unit: unitText, words: null, colour: COLOURS[i % COLOURS.length], ring };
    });
    strip.seconds = times[times.length - 1] - times[0] || 1;
    strip.end = times[times.length - 1];
    strip.events = runEvents();
    charts.style.height = `${Math.max(1, strip.lanes.length) * 86 + 76}px`;
    const passed = run.checks.filter((c) => c.passed).length;
    checksTitle.textContent = run.checks.length ? `Checks: ${passed} of ${run.checks.length} hold` : 'Checks';
    checks.replaceChildren(...(run.checks.length ? run.checks.map((c) => h('li', {}, h('b', { class: c.passed ? 'good' : 'bad', text: c.passed ? 'holds' : 'fails' }), h('code', { text: c.found }))) : [h('li', { class: 'soft', text: 'This run has none, or did not end.' })]),
      ...(passed < run.checks.length ? [h('li', { class: 'soft', text: 'They were written for the scenario as shipped: a change may well break them.' })] : []));
    keep.disabled = !run.run.complete;
    keepName.value = run.name;
    draw();
    setPlaying(roll && !app.still());
    mark();
  }

  function runEvents() {
    const { columns } = run, found = [];
    for (const fault of run.faults) {
      found.push({ time: fault.begin, kind: 'injected', text: `${fault.text} injected` });
      if (fault.end !== null) found.push({ time: fault.end, kind: 'injected', text: `${fault.text} over` });
    }
    (columns.state || []).forEach((state, i) => { if (i && state !== columns.state[i - 1] && state !== null) found.push({ time: columns.time[i], kind: 'state', text: run.words.state[state] }); });
    (columns.limiting || []).forEach((on, i) => { if (i && on && !columns.limiting[i - 1]) found.push({ time: columns.time[i], kind: 'limiter', text: 'limiter holds' }); });
    return found.sort((a, b) => a.time - b.time);
  }

  function setPlaying(on) {
    playing = on && run !== null;
    play.textContent = playing ? 'Pause' : 'Play';
    if (!playing) return;
    const times = run.columns.time, last = times[times.length - 1];
    if (time >= last - 1e-9) time = times[0];
    before = performance.now();
    const step = (now) => {
      if (!playing || !shown) return;
      time = Math.min(last, time + (now - before) / 1000 * Number(pace.value));
      before = now;
      draw();
      if (time >= last) setPlaying(false); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  function draw() {
    if (!run) { robot.draw(); return; }
    const { columns } = run, times = columns.time;
    const row = Math.min(times.length - 1, Math.max(0, (time - times[0]) / ((times[times.length - 1] - times[0]) || 1) * (times.length - 1)));
    robot.row = row;
    robot.draw();
    scrub.value = String(time);
    clock.textContent = `${time.toFixed(2)} s`;
    const value = (key) => at(columns, key, row), whole = (key) => (columns[key] ? columns[key][Math.floor(row)] : null);
    const state = run.words.state[whole('state')];
    facts.textContent = [`at ${number(value('position'), 4)} m`, `${number(value('speed'), 3)} m/s`, `slip ${number(value('slip'), 3)}`, `C_t ${number(value('contact_torque') * 1e3, 4)} mN m, by the controller ${number(whole('estimate') === null ? null : whole('estimate') * 1e3, 4)}${whole('estimate_valid') ? '' : ' (not valid)'}`, `swing ${number(value('swing_angle') / DEGREE, 3)}°`, `slope ${number(value('slope') / DEGREE, 3)}°`, state ? `state ${state}` : ''].filter(Boolean).join('  ·  ');
    if (!playing || performance.now() - (draw.last || 0) > 60) {
      draw.last = performance.now();
      strip.fixed = time;
      strip.draw();
    }
  }

  // ---------------------------------------------------------------- the list of runs, and a case

  async function list() {
    const found = await attempt(() => api('simulate'));
    if (!found) return;
    const ticked = new Set([...runs.querySelectorAll('tr[data-run]')].filter((l) => l.querySelector('input').checked).map((l) => l.dataset.run));
    if (run) ticked.delete(run.name); // marked below
    runs.replaceChildren(found.length ? h('table', {}, h('thead', {}, h('tr', {}, ...['In the case', 'Run', 'Seed', 'Checks', ''].map((t) => h('th', { scope: 'col', text: t })))),
      h('tbody', {}, ...found.map((one) => h('tr', { 'data-run': one.name },
        h('td', {}, h('input', { type: 'checkbox', 'aria-label': `${one.name} in the case`, checked: ticked.has(one.name), disabled: !one.complete })),
        h('td', {}, h('button', { type: 'button', class: 'quiet', text: one.name, onclick: () => open(one.name) })),
        h('td', { text: String(one.seed) }),
        h('td', { class: one.passed ? 'good' : 'warn', text: one.complete ? (one.passed ? 'hold' : 'some fail') : 'cut short' }),
        h('td', {}, h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${one.name}`, onclick: () => attempt(() => api(`simulate/${encodeURIComponent(one.name)}`, { method: 'DELETE' })).then(list) })))))) : h('p', { class: 'soft', text: 'No runs yet.' }));
    mark();
  }
  function mark() {
    for (const line of runs.querySelectorAll('tr[data-run]')) {
      const here = line.dataset.run === run?.name, box = line.querySelector('input');
      line.toggleAttribute('aria-current', here);
      box.checked = here || (box.checked && !box.dataset.own);
      box.dataset.own = here ? '1' : '';
      box.disabled = here || box.disabled;
    }
  }
  async function keepCase() {
    const others = [...runs.querySelectorAll('tr[data-run]')].filter((l) => l.querySelector('input').checked && l.dataset.run !== run.name).map((l) => l.dataset.run);
    const wanted = keepName.value.trim();
    keep.disabled = true;
    const started = await attempt(() => api(`simulate/${encodeURIComponent(run.name)}/case`, { body: { name: wanted, title: run.run.title || '', others } }));
    if (started) {
      app.showCommand(started.command);
      const ended = await watch(started.id, null);
      if (ended?.state === 'done') keepNote.replaceChildren('Kept: ', h('a', { href: `#workbench/${encodeURIComponent(wanted)}`, text: wanted }), ' is in the workbench.');
    }
    keep.disabled = false;
  }

  async function running() {
    const jobs = await attempt(() => api('jobs'));
    const mine = jobs?.find((one) => one.do === 'simulate' && (one.state === 'running' || one.state === 'queued'));
    if (mine && !job) watch(mine.id, /runs\/([^/ ]+)/.exec(mine.command.split('--out ')[1] || '')?.[1] || null);
  }

  app.onEvent((event) => { // what another browser runs
    if (!shown || job || start.disabled || !(event.back || event.do === 'simulate' || event.do === 'case')) return;
    if (event.state === 'running') running();
    else if (event.back || event.error !== undefined) list();
  });

  return {
    show() { shown = true; if (!description) load(); list(); running(); if (run) draw(); else robot.draw(); },
    hide() { shown = false; setPlaying(false); },
    redraw() { draw(); strip.recolour(); },
  };
}
