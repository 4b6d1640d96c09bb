'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const $ = (id) => document.getElementById(id);
  const place = new Map(data.columns.map((c, i) => [c, i]));
  const text = (row, column) => (place.has(column) ? row[place.get(column)] : '');
  const value = (row, column) => {
    const t = text(row, column);
    return t === '' || Number.isNaN(Number(t)) ? null : Number(t);
  };
  const rowOf = new Map(data.rows.map((r) => [text(r, 'run'), r]));
  const make = (tag, attributes = {}, ...children) => {
    const e = tag.startsWith('svg:') ? document.createElementNS('http://www.w3.org/2000/svg', tag.slice(4)) : document.createElement(tag);
    for (const [name, v] of Object.entries(attributes)) if (v !== null && v !== undefined) e.setAttribute(name, v);
    e.append(...children);
    return e;
  };

  // ---- numbers for readers -------------------------------------------------------------------------------------------
  const digits = (v) => {
    if (v === 0) return '0';
    const m = Math.floor(Math.log10(Math.abs(v)));
    const s = m < -4 || m >= 6 ? v.toExponential(2) : String(Number(v.toFixed(Math.max(0, 2 - m))));
    return s.replace('-', '−');
  };
  const percent = (v) => digits(100 * v) + ' %';
  const unit = (v, u) => {
    if (v === 0) return '0 ' + u;
    let k = Math.max(-4, Math.min(3, Math.floor((Math.log10(Math.abs(v)) + 1e-9) / 3)));
    if (u === 'B') k = Math.max(0, k);
    return digits(v / 1000 ** k) + ' ' + ['p', 'n', 'µ', 'm', '', 'k', 'M', 'G'][k + 4] + u;
  };
  const shares = { has: (column) => /nrmse|jump$/.test(column) || ['bias', 'bias_se', 'ref_noise', 'leak', 'clamped_share'].includes(column) };
  const written = (column, t) => {
    const v = t === '' || Number.isNaN(Number(t)) ? null : Number(t);
    if (v === null || column === 'run' || column === 'order' || column === 'frame') return t;
    if (shares.has(column)) return percent(v);
    if (column.includes('_us')) return unit(v * 1e-6, 's');
    if (column.includes('_ns')) return unit(v * 1e-9, 's');
    if (column.endsWith('_bytes')) return unit(v, 'B');
    const about = data.about[column] || {};
    if (about.kind === 'quality' || about.kind === 'cost' || about.unit) return digits(v) + (about.unit ? ' ' + about.unit.replace('^2', '²') : '');
    return t;
  };

  // ---- theme ---------------------------------------------------------------------------------------------------------
  const themes = [['', 'as the system'], ['light', 'light'], ['dark', 'dark']];
  let theme = 0;
  $('theme').addEventListener('click', () => {
    theme = (theme + 1) % themes.length;
    const [name, label] = themes[theme];
    if (name) document.documentElement.dataset.theme = name;
    else delete document.documentElement.dataset.theme;
    $('theme').textContent = 'Theme: ' + label;
    draw();
  });

  // ---- the name of a point, at once -------------------------------------------------------------------------------------
  const tip = $('tip');
  const showTip = (event) => {
    const link = event.target.closest && event.target.closest('.plot a');
    if (!link) { tip.hidden = true; return; }
    tip.textContent = link.getAttribute('aria-label');
    tip.hidden = false;
    const box = link.getBoundingClientRect();
    const x = event.clientX || box.right, y = event.clientY || box.bottom;
    tip.style.left = Math.max(4, Math.min(x + 14, innerWidth - tip.offsetWidth - 8)) + 'px';
    tip.style.top = Math.max(4, Math.min(y + 14, innerHeight - tip.offsetHeight - 8)) + 'px';
  };
  addEventListener('pointermove', showTip);
  addEventListener('focusin', showTip);

  const choice = $('front-case');
  if (choice) choice.addEventListener('change', () => {
    for (const c of document.querySelectorAll('#fronts .case')) c.hidden = c.dataset.case !== choice.value;
  });

  // ---- one run -----------------------------------------------------------------------------------------------------------
  const part = (column, t) => (t === '' || column === 'receiver' || column === 'frame' || Number.isNaN(Number(t)) ? t : shares.has(column) ? percent(Number(t)) : digits(Number(t)));
  const runSection = $('run');
  const definitions = (pairs) => {
    const list = make('dl');
    for (const [name, what, says] of pairs) list.append(make('dt', { title: says }, name), make('dd', {}, what));
    return list;
  };
  const spread = (samples, u, factor) => {
    const low = Math.min(...samples), high = Math.max(...samples), width = 400;
    const x = (v) => (high > low ? 10 + (width - 20) * (v - low) / (high - low) : width / 2);
    const sorted = [...samples].sort((a, b) => a - b);
    const middle = (s) => (s.length % 2 ? s[(s.length - 1) / 2] : (s[s.length / 2 - 1] + s[s.length / 2]) / 2);
    const median = middle(sorted);
    const mad = middle(samples.map((s) => Math.abs(s - median)).sort((a, b) => a - b));
    const says = `${samples.length} sample${samples.length === 1 ? '' : 's'}, median ${unit(median * factor, u)}, median deviation ${unit(mad * factor, u)}, from ${unit(low * factor, u)} to ${unit(high * factor, u)}`;
    const svg = make('svg:svg', { class: 'spread', viewBox: `0 0 ${width} 34`, role: 'img', 'aria-label': says });
    const [from, to] = [Math.max(0, x(median - mad)), Math.min(width, x(median + mad))];
    svg.append(make('svg:rect', { class: 'band', x: from, y: 5, width: Math.max(0, to - from), height: 24 }));
    samples.forEach((s, i) => svg.append(make('svg:circle', { cx: x(s), cy: 10 + (i * 7) % 15, r: 3.5 })));
    svg.append(make('svg:line', { class: 'median', x1: x(median), x2: x(median), y1: 3, y2: 31 }));
    return make('div', {}, svg, make('p', { class: 'help' }, says));
  };
  // the structure of a volume: cells, walls and samples where a plane cuts it
  const structureOf = (s) => {
    const says = `Cut at half height, seen from above: ${s.samples} samples`;
    const svg = make('svg:svg', { class: 'structure', viewBox: `-8 -8 ${s.width + 16} ${s.height + 16}`, role: 'img', 'aria-label': says });
    for (const kind of ['cell', 'wall', 'sample', 'inside']) if (s.paths[kind]) svg.append(make('svg:path', { class: kind, d: s.paths[kind] }));
    const key = make('p', { class: 'help' }, says + '. ', make('span', { class: 'key interpolation' }, 'sample'), ' ', make('span', { class: 'key truncation' }, 'sample inside geometry'), ' ', make('span', { class: 'key wall' }, 'static geometry'));
    return make('div', {}, svg, key);
  };
  // errors frame by frame
  const overFrames = (parts) => {
    const at = (name) => data.part_columns.indexOf(name);
    const rows = parts.filter((p) => p[at('frame')] !== '');
    const lines = ['truncation_nrmse', 'interpolation_nrmse', 'nrmse'].filter((c) => at(c) >= 0)
      .map((c) => [c, rows.map((p) => [Number(p[at('frame')]), Number(p[at(c)])]).filter((v, i) => rows[i][at(c)] !== '')]).filter(([, l]) => l.length > 1);
    if (!lines.length) return null;
    const values = lines.flatMap(([, l]) => l), high = Math.max(...values.map((v) => v[1])) || 1, last = Math.max(...values.map((v) => v[0])) || 1;
    const x = (v) => 58 + 332 * v / last, y = (v) => 112 - 100 * v / high;
    const worst = lines[lines.length - 1][1].reduce((a, b) => (b[1] > a[1] ? b : a));
    const svg = make('svg:svg', { class: 'plot over-frames', viewBox: '0 0 400 142', role: 'img', 'aria-label': `Error over the frames 0 to ${last}: largest in frame ${worst[0]}, ${percent(worst[1])}` });
    for (const v of [0, high / 2, high]) svg.append(make('svg:line', { class: 'grid', x1: 58, x2: 390, y1: y(v), y2: y(v) }), make('svg:text', { class: 'tick', x: 52, y: y(v) + 4, 'text-anchor': 'end' }, percent(v)));
    for (const v of [0, last]) svg.append(make('svg:text', { class: 'tick', x: x(v), y: 130, 'text-anchor': 'middle' }, String(v)));
    svg.append(make('svg:text', { class: 'tick', x: 224, y: 138, 'text-anchor': 'middle' }, 'frame'));
    for (const [c, l] of lines) svg.append(make('svg:polyline', { class: 'curve ' + c, points: l.map((v) => x(v[0]) + ',' + y(v[1])).join(' ') }));
    return svg;
  };
  const showRun = (key, jump) => {
    const row = rowOf.get(key);
    if (!row) return;
    const about = data.runs[key] || { name: key, command: '', links: [] };
    runSection.replaceChildren();
    runSection.dataset.run = key;
    const close = make('button', { type: 'button' }, 'Close');
    close.addEventListener('click', () => { runSection.hidden = true; });
    runSection.append(make('div', { class: 'bar' }, make('h2', { tabindex: -1 }, about.name), close));
    runSection.append(make('p', { class: 'help' }, [text(row, 'family'), text(row, 'scene'), text(row, 'lights'), text(row, 'backend'), text(row, 'adapter')].filter(Boolean).join(' · ')));
    if (text(row, 'status') !== 'ok' && text(row, 'status') !== '') {
      runSection.append(make('p', {}, make('strong', {}, text(row, 'status')), ': ' + text(row, 'note')));
    }
    const columns = make('div', { class: 'columns' });
    const add = (title, ...content) => columns.append(make('div', {}, make('h3', {}, title), ...content));
    const errors = [['the order', 'truncation_nrmse', '--order'], ['the rig', 'interpolation_nrmse', '--rig'], ['together', 'nrmse', '--ink']]
      .map(([name, column, colour]) => [name, value(row, column), colour]).filter((e) => e[1] !== null);
    if (errors.length) {
      const high = Math.max(...errors.map((e) => e[1])) || 1;
      const bars = make('div', { class: 'bars' });
      for (const [name, v, colour] of errors) {
        const fill = make('span', { class: 'fill' });
        fill.style.width = 100 * v / high + '%';
        fill.style.background = `var(${colour})`;
        bars.append(make('span', {}, name), make('span', { class: 'rail' }, fill), make('span', { class: 'number' }, percent(v)));
      }
      add('Where the error comes from', bars);
    }
    const parts = data.parts[key];
    const film = parts && data.part_columns.includes('frame') ? overFrames(parts) : null;
    if (film) add('Error frame by frame', film, make('p', { class: 'help' }, make('span', { class: 'key truncation' }, 'the order'), ' ', make('span', { class: 'key interpolation' }, 'the rig'), ' ', make('span', { class: 'key both' }, 'together')));
    if (about.structure) add('Its cells and samples', structureOf(about.structure));
    if (about.setup_us) add('Setup of a frame, every sample', spread(about.setup_us, 's', 1e-6));
    if (about.eval_ns && about.eval_ns.length) add('Evaluation of a point, every sample', spread(about.eval_ns, 's', 1e-9));
    for (const [kind, title] of [['quality', 'Quality'], ['cost', 'Cost'], ['identity', 'What it is'], ['circumstance', 'How it went']]) {
      const pairs = data.columns.filter((c) => (data.about[c] || {}).kind === kind && text(row, c) !== '')
        .map((c) => [c, written(c, text(row, c)), (data.about[c] || {}).says]);
      if (about.seconds !== undefined && kind === 'circumstance') pairs.push(['seconds', digits(about.seconds) + ' s to render and measure']);
      if (pairs.length) add(title, definitions(pairs));
    }
    runSection.append(columns);
    if (parts) {
      const body = make('tbody');
      const numeric = (c) => c !== 'receiver' && c !== 'frame';
      for (const p of parts) body.append(make('tr', {}, ...p.map((t, i) => make('td', { class: numeric(data.part_columns[i]) ? 'number' : null }, part(data.part_columns[i], t)))));
      const head = make('tr', {}, ...data.part_columns.map((h) => make('th', { scope: 'col' }, h)));
      runSection.append(make('h3', {}, data.part_columns[0] === 't' ? 'Along the parameter' : 'By receiver and frame'), make('div', { class: 'wide' }, make('table', {}, make('thead', {}, head), body)));
    }
    runSection.append(make('h3', {}, 'To make it again'), make('pre', { class: 'command' }, make('code', {}, about.command)));
    const links = make('p', {});
    if (pictureOf(key)) links.append(make('a', { href: '#view-' + key }, 'its pictures'), ' · ');
    for (const [href, what] of about.links) links.append(make('a', { href }, what), ' · ');
    links.append(make('span', { class: 'help' }, 'run ' + key));
    runSection.append(links);
    runSection.hidden = false;
    if (jump) {
      runSection.scrollIntoView({ block: 'start' });
      runSection.querySelector('h2').focus({ preventScroll: true });
    }
  };

  // ---- the table -----------------------------------------------------------------------------------------------------------
  const shown = [
    ['status', 'status'], ['family', 'family'], ['name', 'rig'], ['scene', 'scene'], ['lights', 'lights'], ['backend', 'on'],
    ['nrmse', 'nRMSE'], ['truncation_nrmse', 'the order'], ['interpolation_nrmse', 'the rig'], ['flip', 'FLIP'],
    ['sh_vectors', 'SH vectors'], ['samples', 'samples'], ['model_bytes', 'size'], ['bake_s', 'bake'], ['jump', 'jump'], ['leak', 'leak'], ['setup_us', 'setup'], ['eval_ns_per_point', 'evaluation / point'],
    ['frame_us_1m', 'frame, 1 M points'], ['pareto', 'front'],
    ...(place.has('family') ? [['error', 'f32'], ['worst_t', 'at'], ['f64_error', 'f64'], ['naive_error', 'naive f32'], ['non_finite', 'not finite'], ['singular', 'singular']] : []),
  ].filter(([c]) => c === 'name' || data.rows.some((r) => text(r, c) !== ''));
  const nameOf = (row) => (data.runs[text(row, 'run')] || { name: text(row, 'rig') }).name;
  const cell = (row, column) => (column === 'name' ? nameOf(row) : text(row, column));
  const familyOf = (lights) => lights.split('#')[0];
  const selects = new Map();
  const filters = $('filters');
  for (const column of ['family', 'scene', 'lights', 'rig', 'backend', 'status', ...data.varying.filter((c) => c !== 'receiver')]) {
    const of = (r) => (column === 'lights' ? familyOf(text(r, column)) : text(r, column));
    const values = [...new Set(data.rows.map(of))].filter((v) => v !== '');
    if (values.length < 2) continue;
    const select = make('select', { id: 't-' + column }, make('option', { value: '' }, 'all'), ...values.map((v) => make('option', { value: v }, v)));
    filters.append(make('label', {}, column + ' ', select));
    selects.set(column, [select, of]);
    select.addEventListener('change', () => refresh());
  }
  const byWord = new Intl.Collator('en', { numeric: true });
  let sortColumn = null, descending = false, everything = false;
  const LIMIT = 250;
  const head = make('tr');
  for (const [column, title] of shown) {
    const says = (data.about[column] || {}).says;
    const button = make('button', { type: 'button', title: says }, title);
    const cellHead = make('th', { scope: 'col', 'data-column': column }, button);
    button.addEventListener('click', () => {
      descending = sortColumn === column ? !descending : false;
      sortColumn = column;
      refresh();
    });
    head.append(cellHead);
  }
  document.querySelector('#runs thead').append(head);
  const haystack = data.rows.map((r) => (nameOf(r) + ' ' + r.join(' ')).toLowerCase());
  const chosenRows = () => {
    const words = $('t-search').value.toLowerCase().split(/\s+/).filter(Boolean);
    const frontOnly = $('t-front').checked;
    const kept = [];
    data.rows.forEach((row, i) => {
      for (const [select, of] of selects.values()) if (select.value !== '' && of(row) !== select.value) return;
      if (frontOnly && text(row, 'pareto') === '') return;
      if (!words.every((w) => haystack[i].includes(w))) return;
      kept.push(row);
    });
    if (sortColumn) {
      const key = kept.map((row) => {
        const t = cell(row, sortColumn);
        const number = sortColumn === 'name' || t === '' ? NaN : Number(t);
        return [row, t, number];
      });
      // what has no value stands last, whichever way
      key.sort(([, s, a], [, t, b]) => {
        if ((s === '') !== (t === '')) return s === '' ? 1 : -1;
        const order = Number.isNaN(a) || Number.isNaN(b) ? byWord.compare(s, t) : a - b;
        return descending ? -order : order;
      });
      return key.map(([row]) => row);
    }
    return kept;
  };
  const spreadOf = { setup_us: 'setup_us_mad', eval_ns_per_point: 'eval_ns_per_point_mad' };
  const refresh = () => {
    const rows = chosenRows();
    for (const th of head.children) {
      const own = th.dataset.column === sortColumn;
      if (own) th.setAttribute('aria-sort', descending ? 'descending' : 'ascending');
      else th.removeAttribute('aria-sort');
    }
    const body = document.createDocumentFragment();
    for (const row of everything ? rows : rows.slice(0, LIMIT)) {
      const tr = make('tr', { class: text(row, 'status'), 'data-run': text(row, 'run') });
      for (const [column] of shown) {
        const td = make('td');
        const t = cell(row, column);
        if (column === 'name') td.append(make('a', { href: '#run-' + text(row, 'run') }, t));
        else {
          td.textContent = column === 'flip' && t !== '' ? digits(Number(t)) : written(column, t);
          const mad = spreadOf[column] && text(row, spreadOf[column]);
          if (mad && Number(t) > 0) td.append(make('span', { class: 'help' }, ` ±${digits(100 * Number(mad) / Number(t))} %`));
          if (t !== '' && !Number.isNaN(Number(t))) td.className = 'number';
        }
        tr.append(td);
      }
      body.append(tr);
    }
    document.querySelector('#runs tbody').replaceChildren(body);
    const hidden = everything ? 0 : Math.max(0, rows.length - LIMIT);
    $('t-count').textContent = `${rows.length} of ${data.rows.length} runs` + (hidden ? `, the first ${LIMIT} shown` : '');
    $('t-more').hidden = hidden === 0;
    $('t-more').textContent = `Show ${hidden} more`;
  };
  $('t-more').addEventListener('click', () => { everything = true; refresh(); });
  $('t-search').addEventListener('input', refresh);
  $('t-front').addEventListener('change', refresh);

  // ---- pictures ---------------------------------------------------------------------------------------------------------------
  const pictures = new Map();
  data.cases.forEach((c, i) => c.other || c.candidates.forEach((candidate) => pictures.set(candidate.run, [i, candidate])));
  const pictureOf = (key) => pictures.get(key);
  const bytesOfText = (t) => Uint8Array.from(atob(t), (c) => c.charCodeAt(0));
  let halves = null;
  const halfTable = () => {
    if (halves) return halves;
    halves = new Float32Array(65536);
    for (let i = 0; i < 65536; i++) {
      const sign = i & 0x8000 ? -1 : 1, e = (i >> 10) & 31, m = i & 1023;
      halves[i] = sign * (e === 0 ? m * 2 ** -24 : e === 31 ? (m ? NaN : Infinity) : (1 + m / 1024) * 2 ** (e - 15));
    }
    return halves;
  };
  const unpack = async (id, exponent, count) => {
    const packed = bytesOfText($(id).textContent);
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const table = halfTable(), scale = 2 ** exponent;
    const values = new Float32Array(3 * count);
    for (let c = 0; c < 3; c++) {
      let bits = 0;
      for (let i = 0; i < count; i++) {
        bits = (bits + (bytes[c * count + i] << 8 | bytes[(3 + c) * count + i])) & 0xffff;
        values[3 * i + c] = table[bits] * scale;
      }
    }
    return { values, rest: bytes.subarray(6 * count) };
  };
  // what was unpacked last is kept; the rest is unpacked again when it is looked at
  const cache = new Map();
  const unpacked = (id, exponent, count) => {
    if (!cache.has(id)) {
      cache.set(id, unpack(id, exponent, count));
      if (cache.size > 24) cache.delete(cache.keys().next().value);
    } else {
      const kept = cache.get(id);
      cache.delete(id);
      cache.set(id, kept);
    }
    return cache.get(id);
  };

  // `case` is what is shown, `first` the case whose frames can be chosen
  const view = {
    case: 0, first: 0, run: null, mode: 'side', stops: 0, scale: 0, zoom: 1, x: 0.5, y: 0.5, pixel: null, wipe: 50,
    flicker: false, playing: false, picture: 'picture', error: 'magnitude', now: null,
  };
  const maps = {};
  for (const [name, t] of Object.entries(data.maps)) maps[name] = bytesOfText(t);
  const encode = new Uint8Array(4097);
  for (let i = 0; i <= 4096; i++) {
    const v = i / 4096;
    encode[i] = Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
  }
  const isDark = () => getComputedStyle(document.documentElement).colorScheme.includes('dark');

  const load = async () => {
    const index = view.case, run = view.run, c = data.cases[index], count = c.width * c.height;
    const candidate = c.candidates.find((one) => one.run === run);
    if (!candidate) { $('v-state').textContent = `Of ${nameOf(rowOf.get(run))} there is no picture of this frame: run the experiment again.`; return; }
    const [reference, albedo, error] = await Promise.all([
      unpacked('px-reference-' + index, c.reference, count),
      unpacked('px-albedo-' + index, c.albedo, count),
      unpacked(`px-${index}-${run}`, candidate.exponent, count),
    ]);
    if (view.run !== run || view.case !== index) return;
    const e = error.values, r = reference.values;
    const whole = new Float32Array(e.length);
    for (let i = 0; i < whole.length; i++) whole[i] = r[i] + e[i];
    let sum = 0, lit = 0;
    for (let i = 0; i < count; i++) {
      if (albedo.values[3 * i] > 0 || albedo.values[3 * i + 1] > 0 || albedo.values[3 * i + 2] > 0) {
        sum += r[3 * i] + r[3 * i + 1] + r[3 * i + 2];
        lit += 3;
      }
    }
    view.now = { case: c, reference: r, candidate: whole, error: e, albedo: albedo.values, flip: candidate.flip ? error.rest : null, mean: lit ? sum / lit : 0 };
    draw();
  };

  // the end of each error map's scale, and how a number of it is written
  const errorScale = () => {
    const f = 2 ** view.scale, c = data.cases[view.case];
    if (view.error === 'flip') return { high: Math.min(1, 0.5 * f), write: digits, what: 'FLIP' };
    if (view.error === 'relative') return { high: f, write: percent, what: 'of the pixel’s reference (no less than 1 % of the mean)' };
    return { high: c.high * f, write: percent, what: 'of the reference’s RMS irradiance' };
  };
  const errorAt = (n, i) => {
    const e = n.error, k = 3 * i;
    if (view.error === 'flip') return n.flip ? n.flip[i] / 255 : NaN;
    if (view.error === 'signed') {
      let largest = 0;
      for (let c = 0; c < 3; c++) if (!(Math.abs(e[k + c]) <= Math.abs(largest))) largest = e[k + c];
      return largest / n.case.rms;
    }
    if (view.error === 'relative') {
      let s = 0;
      for (let c = 0; c < 3; c++) s += (e[k + c] / Math.max(n.reference[k + c], 0.01 * n.mean)) ** 2;
      return Math.sqrt(s / 3);
    }
    return Math.sqrt((e[k] ** 2 + e[k + 1] ** 2 + e[k + 2] ** 2) / 3) / n.case.rms;
  };
  // the map's colours by place 0 to 255; sizes go by the square root, so that small ones are told apart
  const placeOf = (v, high) => (view.error === 'signed' ? 0.5 + 0.5 * v / high : view.error === 'flip' ? v / high : Math.sqrt(v / high));
  const irradianceHigh = () => { const c = data.cases[view.case]; return 3 * c.rms / 2 ** view.stops; };

  const paintPicture = (n, values) => (i, out, o) => {
    const k = 3 * i;
    if (view.picture === 'irradiance') {
      const v = 0.2126 * values[k] + 0.7152 * values[k + 1] + 0.0722 * values[k + 2];
      return paintMap(maps.magnitude, v / irradianceHigh(), out, o);
    }
    const gain = n.case.exposure * 2 ** view.stops / Math.PI;
    for (let c = 0; c < 3; c++) {
      const v = values[k + c] * n.albedo[k + c] * gain;
      if (Number.isNaN(v)) { for (let d = 0; d < 3; d++) out[o + d] = data.not_a_number[d]; return; }
      out[o + c] = encode[Math.round(4096 * Math.min(1, Math.max(0, v)))];
    }
  };
  const paintMap = (map, t, out, o) => {
    if (Number.isNaN(t)) { for (let d = 0; d < 3; d++) out[o + d] = data.not_a_number[d]; return; }
    const k = 3 * Math.round(255 * Math.min(1, Math.max(0, t)));
    for (let d = 0; d < 3; d++) out[o + d] = map[k + d];
  };

  // the part of a picture that is in view: whole pixels
  const region = () => {
    const c = data.cases[view.case];
    const width = Math.max(2, Math.round(c.width / view.zoom)), height = Math.max(2, Math.round(c.height / view.zoom));
    const start = (centre, whole, part) => Math.max(0, Math.min(whole - part, Math.round(centre * whole - part / 2)));
    return { x: start(view.x, c.width, width), y: start(view.y, c.height, height), width, height };
  };
  const scratch = document.createElement('canvas');
  const paint = (canvas, paintPixel, values) => {
    const n = view.now, part = region(), shownWidth = canvas.clientWidth || 300;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(shownWidth * ratio)), height = Math.max(1, Math.round(width * part.height / part.width));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    scratch.width = part.width; scratch.height = part.height;
    const context = scratch.getContext('2d');
    const image = context.createImageData(part.width, part.height);
    const ground = isDark() ? [44, 51, 60] : [243, 244, 246];
    for (let y = 0; y < part.height; y++) for (let x = 0; x < part.width; x++) {
      const i = (part.y + y) * n.case.width + part.x + x, o = 4 * (y * part.width + x);
      if (n.albedo[3 * i] > 0 || n.albedo[3 * i + 1] > 0 || n.albedo[3 * i + 2] > 0) paintPixel(i, image.data, o);
      else for (let d = 0; d < 3; d++) image.data[o + d] = ground[d];
      image.data[o + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    const target = canvas.getContext('2d');
    target.imageSmoothingEnabled = false;
    target.drawImage(scratch, 0, 0, width, height);
    const size = width / part.width;
    if (view.pixel && view.pixel.x >= part.x && view.pixel.x < part.x + part.width && view.pixel.y >= part.y && view.pixel.y < part.y + part.height) {
      target.lineWidth = Math.max(1, 2 * ratio);
      for (const [colour, grow] of [['#000', 1], ['#fff', -1]]) {
        target.strokeStyle = colour;
        target.strokeRect((view.pixel.x - part.x) * size - grow, (view.pixel.y - part.y) * size - grow, Math.max(size, 6) + 2 * grow, Math.max(size, 6) + 2 * grow);
      }
    }
    // large pixels say their values
    if (size / ratio >= 44) {
      target.font = `${10 * ratio}px system-ui, sans-serif`;
      target.textAlign = 'center';
      for (let y = 0; y < part.height; y++) for (let x = 0; x < part.width; x++) {
        const o = 4 * (y * part.width + x), d = image.data;
        target.fillStyle = 0.3 * d[o] + 0.59 * d[o + 1] + 0.11 * d[o + 2] > 128 ? '#000' : '#fff';
        const i = (part.y + y) * n.case.width + part.x + x;
        for (let c = 0; c < 3; c++) target.fillText(digits(values[3 * i + c]), (x + 0.5) * size, (y + 0.5) * size + (c - 0.7) * 12 * ratio);
      }
    }
  };
  const paneOf = (name) => { const f = $('pane-' + name); return { figure: f, canvas: f.querySelector('canvas'), caption: f.querySelector('figcaption') }; };
  const bar = (id, map, low, high, what) => {
    const e = $(id), context = e.querySelector('canvas').getContext('2d');
    const image = context.createImageData(256, 1);
    for (let i = 0; i < 256; i++) {
      for (let d = 0; d < 3; d++) image.data[4 * i + d] = map[3 * i + d];
      image.data[4 * i + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    e.querySelector('.low').textContent = low;
    e.querySelector('.high').textContent = high;
    e.querySelector('.what').textContent = what;
  };
  function draw() {
    const n = view.now;
    if (!n) return;
    const row = rowOf.get(view.run), name = nameOf(row), frame = n.case.frame;
    const place = `${n.case.scene} under ${n.case.lights}` + (frame === null ? '' : `, frame ${frame}`);
    const side = view.mode === 'side';
    $('v-panes').classList.toggle('two', !side);
    const [reference, candidate, error] = ['reference', 'candidate', 'error'].map(paneOf);
    reference.figure.hidden = !side;
    $('v-wipe-label').hidden = view.mode !== 'slider';
    $('v-flick').hidden = view.mode !== 'flicker';
    $('v-flick').textContent = view.playing ? 'Stop' : 'Flicker';
    const say = (pane, caption, description) => { pane.caption.textContent = caption; pane.canvas.setAttribute('aria-label', description); };
    const nrmse = value(row, 'nrmse');
    const quality = nrmse === null ? '' : `, nRMSE ${percent(nrmse)}` + (frame === null ? '' : ' over all frames');
    if (side) {
      paint(reference.canvas, paintPicture(n, n.reference), n.reference);
      say(reference, 'reference', `Reference picture of ${place}`);
    }
    if (view.mode === 'flicker' && view.flicker) {
      paint(candidate.canvas, paintPicture(n, n.reference), n.reference);
      say(candidate, 'reference (flicker)', `Reference picture of ${place}, flickering with ${name}`);
    } else if (view.mode === 'slider') {
      const part = region(), edge = part.x + part.width * view.wipe / 100;
      const left = paintPicture(n, n.reference), right = paintPicture(n, n.candidate);
      paint(candidate.canvas, (i, out, o) => ((i % n.case.width) + 0.5 < edge ? left : right)(i, out, o), n.candidate);
      const context = candidate.canvas.getContext('2d'), x = candidate.canvas.width * view.wipe / 100;
      context.fillStyle = '#fff'; context.fillRect(x - 1, 0, 3, candidate.canvas.height);
      context.fillStyle = '#000'; context.fillRect(x, 0, 1, candidate.canvas.height);
      say(candidate, `reference | ${name}`, `Left of the slider the reference of ${place}, right of it ${name}${quality}`);
    } else {
      paint(candidate.canvas, paintPicture(n, n.candidate), n.candidate);
      say(candidate, name + quality, `Picture of ${place} by ${name}${quality}`);
    }
    const scale = errorScale(), map = view.error === 'signed' ? maps.signed : maps.magnitude;
    paint(error.canvas, (i, out, o) => paintMap(map, placeOf(errorAt(n, i), scale.high), out, o), n.error);
    const kind = $('v-error').selectedOptions[0].textContent;
    say(error, `error: ${kind}`, `Error map of ${name} for ${place}: ${kind}, colours up to ${scale.write(scale.high)} ${scale.what}`);
    const low = view.error === 'signed' ? scale.write(-scale.high) : '0';
    bar('bar-error', map, low, scale.write(scale.high), scale.what + (view.error === 'magnitude' || view.error === 'relative' ? ', square-root scale' : ''));
    $('bar-picture').hidden = view.picture !== 'irradiance';
    bar('bar-picture', maps.magnitude, '0', digits(irradianceHigh()) + ' W/m²', 'irradiance, luminance');
    $('v-stops-value').textContent = `${view.stops > 0 ? '+' : view.stops < 0 ? '−' : ''}${Math.abs(view.stops)} stops`;
    $('v-scale-value').textContent = 'to ' + scale.write(scale.high);
    $('v-zoom-value').textContent = view.zoom + ' ×';
    $('v-state').textContent = `${place}: ${name}${quality}. ` + (n.flip || view.error !== 'flip' ? '' : 'No FLIP map: the picture holds values that are not finite.');
    readPixel();
  }
  const readPixel = () => {
    const n = view.now, p = view.pixel, table = $('v-pixel');
    const body = table.tBodies[0];
    table.classList.toggle('pointed', Boolean(p));
    if (!p) { table.caption.textContent = 'Point at a pixel, or focus a picture and use the arrow keys, for its values.'; body.replaceChildren(); return; }
    const i = p.y * n.case.width + p.x, k = 3 * i;
    const all = ['magnitude', 'signed', 'relative', 'flip'].map((kind) => { const kept = view.error; view.error = kind; const v = errorAt(n, i); view.error = kept; return v; });
    table.caption.textContent = `Pixel ${p.x}, ${p.y}: irradiance, W/m². Error ${percent(all[0])} of the RMS, ${percent(all[2])} of the pixel` + (n.flip ? `, FLIP ${digits(all[3])}` : '');
    const line = (name, values) => make('tr', {}, make('th', { scope: 'row' }, name), ...[0, 1, 2].map((c) => make('td', {}, digits(values[k + c]))));
    body.replaceChildren(line('reference', n.reference), line('candidate', n.candidate), line('error', n.error));
  };

  const frames = () => data.cases[view.first].frames;
  const chooseFrame = (place) => {
    const all = frames();
    if (!all.length) return;
    const at = Math.max(0, Math.min(all.length - 1, place));
    $('v-frame').value = at;
    view.case = all[at];
    $('v-frame-value').textContent = data.cases[view.case].frame;
    load();
  };
  let film = null;
  const playFilm = (on) => {
    clearInterval(film);
    film = on ? setInterval(() => chooseFrame((Number($('v-frame').value) + 1) % frames().length), 350) : null;
    $('v-play').textContent = on ? 'Stop' : 'Play';
  };
  const chooseCase = (index, run) => {
    playFilm(false);
    view.case = view.first = index;
    const c = data.cases[index];
    for (const id of ['v-frame-label', 'v-play']) $(id).hidden = !c.frames.length;
    $('v-frame').max = Math.max(0, c.frames.length - 1);
    $('v-frame').value = c.frames.indexOf(index);
    $('v-frame-value').textContent = c.frame === null ? '' : c.frame;
    $('v-case').value = index;
    $('v-run').replaceChildren(...c.candidates.map((candidate) => {
      const row = rowOf.get(candidate.run), e = value(row, 'nrmse');
      const more = [text(row, 'backend') === 'cpu' ? '' : text(row, 'backend'), e === null ? '' : percent(e)].filter(Boolean).join(', ');
      return make('option', { value: candidate.run }, nameOf(row) + (more ? ` (${more})` : ''));
    }));
    view.pixel = null;
    chooseRun(run || c.candidates[0].run);
  };
  const chooseRun = (run) => {
    view.run = run;
    $('v-run').value = run;
    load();
  };
  let timer = null;
  const play = (on) => {
    view.playing = on;
    clearInterval(timer);
    if (on) timer = setInterval(() => { view.flicker = !view.flicker; draw(); }, 600);
    draw();
  };
  if (data.cases.length) {
    // room for the pictures before they are there, so that nothing moves when they come
    for (const canvas of document.querySelectorAll('#v-panes canvas')) { canvas.width = data.cases[0].width; canvas.height = data.cases[0].height; }
    data.cases.forEach((c, i) => c.other || $('v-case').append(make('option', { value: i }, `${c.scene}, ${c.lights}`)));
    $('v-case').addEventListener('change', () => chooseCase(Number($('v-case').value)));
    $('v-run').addEventListener('change', () => chooseRun($('v-run').value));
    const range = (id, set) => $(id).addEventListener('input', () => { set(Number($(id).value)); draw(); });
    range('v-stops', (v) => { view.stops = v; });
    range('v-scale', (v) => { view.scale = v; });
    range('v-zoom', (v) => { view.zoom = 2 ** v; });
    range('v-wipe', (v) => { view.wipe = v; });
    $('v-frame').addEventListener('input', () => { playFilm(false); chooseFrame(Number($('v-frame').value)); });
    $('v-play').addEventListener('click', () => playFilm(film === null));
    $('v-picture').addEventListener('change', () => { view.picture = $('v-picture').value; draw(); });
    $('v-error').addEventListener('change', () => { view.error = $('v-error').value; draw(); });
    const setMode = (mode) => {
      view.mode = mode;
      view.flicker = false;
      document.querySelector(`input[name="v-mode"][value="${mode}"]`).checked = true;
      // who asked for less motion flickers by hand
      play(mode === 'flicker' && !matchMedia('(prefers-reduced-motion: reduce)').matches);
    };
    for (const radio of document.querySelectorAll('input[name="v-mode"]')) radio.addEventListener('change', () => setMode(radio.value));
    $('v-flick').addEventListener('click', () => play(!view.playing));

    const pixelAt = (canvas, event) => {
      const box = canvas.getBoundingClientRect(), part = region();
      const along = (v, start, length, first, count) => first + Math.max(0, Math.min(count - 1, Math.floor((v - start) / length * count)));
      return { x: along(event.clientX, box.left, box.width, part.x, part.width), y: along(event.clientY, box.top, box.height, part.y, part.height) };
    };
    const zoomBy = (steps) => {
      const input = $('v-zoom');
      input.value = Math.max(0, Math.min(6, Number(input.value) + steps));
      view.zoom = 2 ** Number(input.value);
      if (view.pixel) centreOnPixel();
      draw();
    };
    const centreOnPixel = () => {
      const c = data.cases[view.case], part = region(), p = view.pixel;
      const inside = p.x >= part.x && p.x < part.x + part.width && p.y >= part.y && p.y < part.y + part.height;
      if (!inside || view.zoom > 1) { view.x = (p.x + 0.5) / c.width; view.y = (p.y + 0.5) / c.height; }
    };
    const step = (select, by) => {
      const next = select.selectedIndex + by;
      if (next < 0 || next >= select.options.length) return;
      select.selectedIndex = next;
      select.dispatchEvent(new Event('change'));
    };
    for (const name of ['reference', 'candidate', 'error']) {
      const { canvas } = paneOf(name);
      let drag = null;
      canvas.addEventListener('pointerdown', (event) => {
        canvas.setPointerCapture(event.pointerId);
        drag = { x: event.clientX, y: event.clientY, vx: view.x, vy: view.y };
      });
      canvas.addEventListener('pointerup', () => { drag = null; });
      canvas.addEventListener('pointermove', (event) => {
        if (!view.now) return;
        const box = canvas.getBoundingClientRect();
        if (drag && view.mode === 'slider' && name === 'candidate' && view.zoom === 1) {
          view.wipe = Math.max(0, Math.min(100, 100 * (event.clientX - box.left) / box.width));
          $('v-wipe').value = view.wipe;
        } else if (drag && view.zoom > 1) {
          const clamp = (v) => Math.max(0, Math.min(1, v));
          view.x = clamp(drag.vx - (event.clientX - drag.x) / box.width / view.zoom);
          view.y = clamp(drag.vy - (event.clientY - drag.y) / box.height / view.zoom);
        }
        view.pixel = pixelAt(canvas, event);
        draw();
      });
      canvas.addEventListener('wheel', (event) => {
        if (!event.ctrlKey && !event.altKey) return;
        event.preventDefault();
        view.pixel = pixelAt(canvas, event);
        zoomBy(event.deltaY < 0 ? 1 : -1);
      }, { passive: false });
      canvas.addEventListener('keydown', (event) => {
        if (!view.now || event.ctrlKey || event.metaKey || event.altKey) return;
        const c = data.cases[view.case], arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
        const by = arrows[event.key];
        if (by) {
          const p = view.pixel || { x: c.width >> 1, y: c.height >> 1 }, far = event.shiftKey ? 10 : 1;
          view.pixel = { x: Math.max(0, Math.min(c.width - 1, p.x + far * by[0])), y: Math.max(0, Math.min(c.height - 1, p.y + far * by[1])) };
          centreOnPixel();
          draw();
        } else if (event.key === '+' || event.key === '=') zoomBy(1);
        else if (event.key === '-') zoomBy(-1);
        else if (event.key === 'n') step($('v-run'), 1);
        else if (event.key === 'p') step($('v-run'), -1);
        else if (event.key === ',') chooseFrame(Number($('v-frame').value) - 1);
        else if (event.key === '.') chooseFrame(Number($('v-frame').value) + 1);
        else if (event.key === 'f') {
          if (view.mode !== 'flicker') setMode('flicker');
          else { play(false); view.flicker = !view.flicker; draw(); }
        } else if (event.key === 'e') {
          const select = $('v-error');
          select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
          select.dispatchEvent(new Event('change'));
        } else if (event.key === '[' || event.key === ']') {
          $('v-stops').value = Number($('v-stops').value) + (event.key === ']' ? 0.5 : -0.5);
          $('v-stops').dispatchEvent(new Event('input'));
        } else return;
        event.preventDefault();
      });
    }
    new ResizeObserver(() => draw()).observe($('v-panes'));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
    // pictures are unpacked when their section comes near
    const watch = new IntersectionObserver((entries) => {
      if (entries.some((e) => e.isIntersecting) && !view.run) { watch.disconnect(); chooseCase(0); }
    }, { rootMargin: '400px' });
    addEventListener('load', () => watch.observe($('viewer')));
    addEventListener('beforeprint', () => { if (!view.run) chooseCase(0); });
  }

  // ---- places -------------------------------------------------------------------------------------------------------------------
  const follow = () => {
    const [, what, key] = /^#(run|view)-([0-9a-f]+)$/.exec(location.hash) || [];
    if (what === 'run') showRun(key, true);
    else if (what === 'view' && pictureOf(key)) {
      chooseCase(pictureOf(key)[0], key);
      $('viewer').scrollIntoView({ block: 'start' });
    }
  };
  addEventListener('hashchange', follow);
  // a link to the place where one is already leads there again
  addEventListener('click', (event) => {
    const link = event.target.closest && event.target.closest('a[href^="#run-"], a[href^="#view-"]');
    const href = link && (link.getAttribute('href'));
    if (href && href === location.hash) follow();
  });
  refresh();
  addEventListener('load', follow);
})();
