// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report_style.h"

namespace vitreo {

const char* const kReportStyle = R"css(
:root { color-scheme: light; --ink: #1f252b; --soft: #59626b; --line: #dde1e5; --wash: #f5f6f8; }
* { box-sizing: border-box; }
body { margin: 0; background: #eceef1; color: var(--ink); line-height: 1.45;
       font: 15px/1.45 "Helvetica Neue", Helvetica, Arial, "Liberation Sans", sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 36px 44px 48px; background: #fff; min-height: 100vh; }
header { display: flex; flex-wrap: wrap; gap: 6px 18px; align-items: center; }
h1 { font-size: 27px; line-height: 1.2; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 17px; margin: 34px 0 10px; padding-bottom: 5px; border-bottom: 1px solid var(--line); }
.badge { font-size: 13px; font-weight: 600; padding: 3px 11px; border-radius: 13px; color: #fff; white-space: nowrap; }
.completed { background: #00724f; } .failed { background: #b03a00; } .stopped, .aborted { background: #8a6100; }
.running { background: var(--soft); }
.reason { flex-basis: 100%; margin: 4px 0 0; padding: 8px 12px; border-left: 4px solid #b03a00; background: #fdf3ee;
          overflow-wrap: anywhere; white-space: pre-wrap; }
.facts { display: flex; flex-wrap: wrap; gap: 4px 26px; margin: 10px 0 0; color: var(--soft); font-size: 14px; }
.facts b { color: var(--ink); font-weight: 500; overflow-wrap: anywhere; }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(190px, 1fr)); gap: 12px; margin-top: 22px; }
.tile { border: 1px solid var(--line); border-radius: 8px; padding: 12px 16px 10px; break-inside: avoid; min-width: 0; }
.tile .name { color: var(--soft); font-size: 13px; overflow-wrap: anywhere; }
.tile .value { font-size: 29px; font-weight: 600; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tile .value.long { font-size: 22px; line-height: 1.65; }
.tile .unit { font-size: 16px; font-weight: 500; color: var(--soft); }
.plots { display: grid; grid-template-columns: 1fr 1fr; gap: 14px 20px; margin-top: 22px; }
.plots > figure { margin: 0; break-inside: avoid; min-width: 0; } .plots > .wide { grid-column: 1 / -1; }
svg { display: block; width: 100%; height: auto; }
.plots img { display: block; max-width: 100%; height: auto; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 330px), 1fr)); gap: 18px 20px; }
.pictures figure { margin: 0; break-inside: avoid; }
.pictures img { display: block; width: 100%; height: auto; border: 1px solid var(--line); background: #000; }
figcaption { color: var(--soft); font-size: 13px; margin-top: 6px; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: 0 0 16px; break-inside: avoid; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
.caption { font-size: 14px; font-weight: 600; margin: 4px 0 6px; }
th, td { padding: 5px 18px 5px 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line);
         overflow-wrap: break-word; }
th { color: var(--soft); font-weight: 600; } thead th { border-bottom: 1.5px solid #aab1b8; }
thead th, tbody th { white-space: nowrap; } td:last-child, th:last-child { padding-right: 0; }
.right { text-align: right; } .short { white-space: nowrap; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); gap: 0 44px; }
.columns > section { min-width: 0; } .columns table { width: 100%; }
.columns tbody th { width: 34%; font-weight: 500; white-space: normal; }
.events td { white-space: nowrap; } .events td:first-child { color: var(--soft); }
.events td:last-child { white-space: pre-wrap; width: 100%; overflow-wrap: anywhere; }
.mark { display: inline-block; font-size: 12px; padding: 0 8px; border-radius: 9px; background: var(--wash);
        border: 1px solid var(--line); white-space: nowrap; }
.mark.error { background: #fdf3ee; border-color: #e9bfa8; }
details { border: 1px solid var(--line); border-radius: 8px; margin: 10px 0; padding: 0 14px; }
summary { cursor: pointer; padding: 9px 0; font-weight: 600; }
pre { font: 12.5px/1.5 "DejaVu Sans Mono", Menlo, Consolas, monospace; background: var(--wash); padding: 12px 14px;
      margin: 0 0 14px; overflow-x: auto; white-space: pre-wrap; overflow-wrap: anywhere; border-radius: 6px; }
code { font: 12.5px "DejaVu Sans Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
footer { margin-top: 36px; color: var(--soft); font-size: 12.5px; border-top: 1px solid var(--line); padding-top: 10px; }
@media (max-width: 760px) { main { padding: 20px 16px; } .plots { grid-template-columns: 1fr; } }
@page { size: A4; margin: 14mm 13mm; }
@media print {
  body { background: #fff; font-size: 9.5pt; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  main { max-width: none; padding: 0; min-height: 0; }
  h1 { font-size: 17pt; } h2 { font-size: 12pt; margin-top: 16pt; break-after: avoid; }
  .tiles { grid-template-columns: repeat(4, 1fr); gap: 6pt; } .tile { padding: 6pt 8pt; }
  .tile .value { font-size: 16pt; } .tile .value.long { font-size: 12pt; }
  .plots { grid-template-columns: 1fr 1fr; } .pictures { grid-template-columns: 1fr 1fr 1fr; gap: 8pt; }
  .scroll { overflow: visible; } .long { break-inside: auto; } tr { break-inside: avoid; }
  .caption, thead { break-after: avoid; } tbody tr:first-child { break-before: avoid; }
  .columns { grid-template-columns: 1fr 1fr; gap: 0 14pt; }
  th, td { padding-right: 10pt; }
  table, figcaption, .caption { font-size: 8.5pt; } details { border: 0; padding: 0; } pre { font-size: 7pt; }
}
)css";

}  // namespace vitreo
