// Quantities as people read them: the rules of host/text/units.h and host/text/columns.h. A test runs both on one table of
// values (tests/host/text/columns_test.cpp).

const kDegree = Math.PI / 180;
const kNothing = 1e-8; // of the smallest unit there is: what a subtraction of doubles leaves counts as zero

// Dimension: [unit in print, factor, used from (SI) upwards], largest first.
const kUnits = {
  m: [['m', 1, 1], ['mm', 1e-3, 1e-3], ['µm', 1e-6, 1e-7], ['nm', 1e-9, 0]],
  'm/s': [['m/s', 1, 1], ['mm/s', 1e-3, 1e-4], ['µm/s', 1e-6, 0]],
  s: [['s', 1, 1], ['ms', 1e-3, 1e-3], ['µs', 1e-6, 1e-6], ['ns', 1e-9, 0]],
  T: [['T', 1, 1], ['mT', 1e-3, 1e-4], ['µT', 1e-6, 0]],
  A: [['A', 1, 0.1], ['mA', 1e-3, 1e-4], ['µA', 1e-6, 0]],
  rad: [['°', kDegree, 0]],
  K: [['°C', 1, 200], ['K', 1, 0.1], ['mK', 1e-3, 0]],
  Hz: [['MHz', 1e6, 1e6], ['kHz', 1e3, 1e4], ['Hz', 1, 0]],
  '%': [['%', 1e-2, 0]],
};
const kUsual = { m: 'mm', 'm/s': 'mm/s', T: 'mT', K: 'K', Hz: 'Hz' }; // of zero
const kLonger = [['h', 3600, 7200], ['min', 60, 600]]; // times in a column

const offsetOf = (unit) => (unit[0] === '°C' ? 273.15 : 0);
const fromSi = (unit, value) => (value - offsetOf(unit)) / unit[1];
const unitsOf = (dimension) => kUnits[dimension] ?? [[dimension, 1, 0]];
const usualOf = (dimension) => {
  const units = unitsOf(dimension);
  return units.find(([symbol]) => symbol === kUsual[dimension]) ?? units[0];
};

/** toFixed() and toExponential(), but a tie goes to the even digit, as C++ has it. */
function even(text, exact) {
  const digits = text.match(/^-?[\d.]*/)[0];
  if (!/^50*$/.test(exact)) return text;
  const last = Number(digits.slice(-1));
  return last % 2 === 0 ? text : null;
}

function fixedText(number, decimals) {
  const up = number.toFixed(decimals);
  const whole = Math.abs(number).toFixed(Math.min(100, decimals + 60));
  const tail = decimals === 0 ? whole.slice(whole.indexOf('.') + 1) : whole.slice(whole.indexOf('.') + 1 + decimals);
  if (even(up, tail) !== null) return up;
  const down = whole.slice(0, whole.length - tail.length).replace(/\.$/, '');
  return number < 0 ? `-${down}` : down;
}

function exponentText(number, decimals) {
  const up = number.toExponential(decimals);
  const [mantissa, exponent] = Math.abs(number).toExponential(Math.min(100, decimals + 60)).split('e');
  const tail = mantissa.slice(decimals === 0 ? 2 : 2 + decimals);
  if (even(up, tail) !== null) return up;
  const down = mantissa.slice(0, mantissa.length - tail.length).replace(/\.$/, '');
  return `${number < 0 ? '-' : ''}${down}e${exponent}`;
}

const rounded = (number, digits) => (number === 0 ? 0 : Number(exponentText(number, digits - 1)));
const exponentOf = (number, digits) => Number(exponentText(Math.abs(number), digits - 1).split('e')[1]);
const decimalsFor = (number, digits) => (number === 0 ? 0 : Math.max(0, digits - 1 - exponentOf(number, digits)));
const notFinite = (number) => (Number.isNaN(number) ? 'not a number' : number > 0 ? 'infinity' : '-infinity');
const stripped = (text) => (text.includes('.') ? text.replace(/\.?0+$/, '') : text);

/** `digits` significant digits, without trailing zeros. */
export function formatNumber(number, digits = 3) {
  if (!Number.isFinite(number)) return notFinite(number);
  const value = rounded(number, digits);
  if (value === 0) return '0';
  const exponent = Math.floor(Math.log10(Math.abs(value)) + 1e-12);
  if (exponent < -4 || exponent > Math.max(7, digits)) {
    const [mantissa, power] = exponentText(value, digits - 1).split('e');
    return `${stripped(mantissa)}e${power[0]}${power.slice(1).padStart(2, '0')}`;
  }
  return stripped(fixedText(exponent >= digits ? number : value, Math.max(0, digits - 1 - exponent)));
}

function minutes(seconds) {
  const whole = Math.round(Math.abs(seconds)), sign = seconds < 0 ? '-' : '';
  const two = (n) => String(n).padStart(2, '0');
  if (whole < 3600) return `${sign}${Math.floor(whole / 60)} min ${two(whole % 60)} s`;
  return `${sign}${Math.floor(whole / 3600)} h ${two(Math.floor((whole % 3600) / 60))} min`;
}

const withUnit = (number, unit) => number + (unit === '' || unit === '°' ? '' : ' ') + unit;

/** "220 µm" of 220e-6 and "m": the unit that fits the size; `dimension` SI, or "%" for a ratio that is shown so. */
export function formatQuantity(value, dimension, digits = 3) {
  if (!Number.isFinite(value)) return notFinite(value);
  if (dimension === 's' && Math.round(Math.abs(value)) >= 60) return minutes(value);
  // Below zero kelvins are a difference, however large.
  const size = Math.min(Math.abs(rounded(value, digits)), dimension === 'K' && value < 0 ? 199 : Infinity);
  const unit = size === 0 ? usualOf(dimension) : unitsOf(dimension).find(([, , from]) => size >= from * (1 - 1e-12));
  let number = fromSi(unit, value);
  if (unit[1] < 1 && Math.abs(number) < kNothing) number = 0;
  return withUnit(formatNumber(number, digits), unit[0]);
}

function columnUnit(values, dimension) {
  const units = [...(dimension === 's' ? kLonger : []), ...unitsOf(dimension)];
  const least = kNothing * units[units.length - 1][1];
  const sizes = values.filter((value) => Number.isFinite(value) && Math.abs(value) >= least).map(Math.abs);
  if (sizes.length === 0) return usualOf(dimension);
  const smallest = Math.min(...sizes), largest = Math.max(...sizes);
  let i = 0;
  while (i + 1 < units.length && (offsetOf(units[i]) ? smallest : largest) < units[i][2] * (1 - 1e-12)) ++i;
  while (!offsetOf(units[i]) && i + 1 < units.length && smallest / units[i][1] < 0.1 && largest / units[i + 1][1] < 1e5) ++i;
  return units[i];
}

function fixed(number, decimals) {
  if (!Number.isFinite(number)) return notFinite(number);
  const text = fixedText(number, decimals);
  return /^-[0.]+$/.test(text) ? text.slice(1) : text;
}

/** Several values of one dimension, in one unit and with the same decimals: { numbers, unit }. */
export function showColumn(values, dimension, digits = 3) {
  const unit = columnUnit(values, dimension);
  const numbers = values.map((value) => fromSi(unit, value));
  const sizes = numbers.filter((n) => Number.isFinite(n) && Math.abs(n) >= (unit[1] < 1 ? kNothing : 0)).map(Math.abs);
  const largest = Math.max(0, ...sizes), nonzero = sizes.filter((n) => n > 0);
  let decimals = decimalsFor(largest, digits);
  if (nonzero.length > 0) decimals = Math.max(decimals, decimalsFor(Math.min(...nonzero), 2));
  decimals = Math.min(decimals, Math.max(6, decimalsFor(largest, digits)));
  let texts = numbers.map((number) => fixed(number, decimals));
  while (decimals > 0 && texts.every((text) => !text.includes('.') || text.endsWith('0'))) {
    texts = texts.map((text) => (text.includes('.') ? text.slice(0, -1).replace(/\.$/, '') : text));
    --decimals;
  }
  return { numbers: texts, unit: unit[0] };
}

/** "12.34 ± 0.42 µm": the uncertainty to two significant digits, the value to the same place. */
export function formatMeasured(value, uncertainty, dimension, digits = 3) {
  if (!Number.isFinite(value) || !Number.isFinite(uncertainty) || uncertainty <= 0) return formatQuantity(value, dimension, digits);
  const unit = columnUnit([dimension === 'K' ? value : Math.max(Math.abs(value), uncertainty)], dimension);
  const spread = uncertainty / unit[1];
  const place = 1 - exponentOf(spread, 2);
  const step = 10 ** -place;
  const shown = (n) => (place >= 0 ? fixed(n, place) : fixed(Number(fixedText(n / step, 0)) * step, 0));
  return withUnit(`${shown(fromSi(unit, value))} ± ${shown(spread)}`, unit[0]);
}
