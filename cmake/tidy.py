#!/usr/bin/env python3
"""clang-tidy over our own sources, many in one translation unit: most of its time goes into the headers of Eigen, OpenCV and
the JSON library, which one source after the other would read and match again (50 s each, seven hours for all).

    tidy.py BUILD [--jobs N] [--only PART]

BUILD has compile_commands.json, without precompiled headers. Sources whose unnamed namespaces have a name in common are in
different units; a unit that does not compile is split. What clang-tidy looks for in main files alone (unused using
declarations and aliases) is not found. Exits with 1 where something was found.
SPDX-License-Identifier: Apache-2.0
"""
import argparse
import concurrent.futures
import json
import pathlib
import re
import subprocess
import sys

MOST = 24  # sources in one unit: more want more memory than they save time
HEADERS = r'(control|devices|host|optics|vision)/.*'
# Bodies that the source of each instruction set includes in a namespace of its own.
MEANT = re.compile(r'batch_kernel_\w+\.h:.*misc-definitions-in-headers')
OF_UNITS = re.compile(r'redefinition of|ambiguous|clang-diagnostic-error|previous definition')


def hidden_names(source):
    """Names at the outermost level of the unnamed namespaces; a few too many, for it splits at every bracket and sign."""
    text = re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"', ' ', source, flags=re.S)
    names = set()
    for opening in re.finditer(r'\bnamespace \{', text):
        depth, level = 1, []
        for i in range(opening.end(), len(text)):
            if text[i] == '}':
                depth -= 1
                level.append(' ')
            if depth == 1:
                level.append(text[i])
            if text[i] == '{':
                depth += 1
            if depth == 0:
                break
        names.update(re.findall(r'\b([A-Za-z_]\w*)\s*(?=[({=;\[])', ''.join(level)))
    return names - {'if', 'for', 'while', 'switch', 'return', 'sizeof', 'decltype', 'noexcept', 'alignas'}


def units_of(sources):
    """Greedy: each source into the first unit of its flags that has room and none of its names."""
    units = []
    for source, flags in sources:
        names = hidden_names(source.read_text(encoding='utf-8'))
        for unit in units:
            if unit['flags'] == flags and len(unit['sources']) < MOST and not unit['names'] & names:
                unit['sources'].append(source)
                unit['names'] |= names
                break
        else:
            units.append({'flags': flags, 'sources': [source], 'names': names})
    return [(unit['flags'], unit['sources']) for unit in units]


def flags_of(command):
    """What of a compiler's call matters to the source: definitions, folders and the language."""
    words = command.split()
    kept = []
    for i, word in enumerate(words):
        if word.startswith(('-D', '-I', '-std')):
            kept.append(word.replace('\\"', '"'))
        elif word == '-isystem':
            kept += [word, words[i + 1]]
    return tuple(kept)


def tidy(folder, unit):
    """Findings, a line each; without those that only say that sources do not go together."""
    flags, sources = unit
    file = folder / f'{abs(hash(unit))}.cpp'
    file.write_text(''.join(f'#include "{source}"\n' for source in sources), encoding='utf-8')
    ran = subprocess.run(
        ['clang-tidy', '--quiet', f'--header-filter={HEADERS}', f'--config-file={pathlib.Path(".clang-tidy").absolute()}',
         '--checks=-bugprone-suspicious-include', str(file), '--', *flags], capture_output=True, text=True, check=False)
    lines = [line for line in ran.stdout.splitlines() if re.search(r': (warning|error): ', line) and not MEANT.search(line)]
    if any(OF_UNITS.search(line) for line in lines) and len(sources) > 1:
        half = len(sources) // 2
        return tidy(folder, (flags, sources[:half])) + tidy(folder, (flags, sources[half:]))
    if ran.returncode != 0 and not ran.stdout.strip():
        lines = [f'{sources[0]}: clang-tidy: {ran.stderr.strip()[-300:]}']
    print(f'{len(sources)} sources from {sources[0]}: {len(lines)} findings', flush=True)
    return lines


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('build', type=pathlib.Path)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--only', default='')
    options = parser.parse_args()
    ours = subprocess.run(['git', 'ls-files', '*.cpp'], capture_output=True, text=True, check=True).stdout.split()
    ours = {str(pathlib.Path(name).absolute()) for name in ours
            if not name.startswith('tests/') and options.only in name}
    calls = json.loads((options.build / 'compile_commands.json').read_text(encoding='utf-8'))
    calls = {call['file']: flags_of(call['command']) for call in calls if call['file'] in ours}
    folder = options.build / 'tidy'
    folder.mkdir(exist_ok=True)
    units = units_of([(pathlib.Path(name), flags) for name, flags in sorted(calls.items())])
    print(f'{len(calls)} sources in {len(units)} units', flush=True)
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        found = sorted({line for lines in pool.map(lambda unit: tidy(folder, (unit[0], tuple(unit[1]))), units) for line in lines})
    print('\n'.join(found))
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main())
