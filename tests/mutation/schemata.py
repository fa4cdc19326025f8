#!/usr/bin/env python3
"""Rewrites a source so that each of its mutants can be chosen at run time (tests/mutation/mutant.h).

    schemata.py FIRST_NUMBER SOURCE OUTPUT LIST

Works on tokens, in the layout that clang-format gives: a relational or arithmetic operator stands
between two spaces, a template's bracket does not. LIST gets a line for each mutant: number, file,
line, class, and the line of the source.
SPDX-License-Identifier: Apache-2.0
"""
import re
import sys

RELATIONS = {'<': 'less', '<=': 'less_equal', '>': 'greater', '>=': 'greater_equal',
             '==': 'equal', '!=': 'unequal'}
SUMS = {'+': 'plus', '-': 'minus'}
PRODUCTS = {'*': 'times', '/': 'over'}
CLOSING = {')': '(', ']': '[', '}': '{'}
TOKEN = re.compile(r'''R"\(.*?\)"|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])+'|//[^\n]*|/\*.*?\*/
  |[A-Za-z_][A-Za-z0-9_]*|0x[0-9A-Fa-f]+U?|\d[\d']*(?:\.\d*)?(?:[eE][-+]?\d+)?[A-Za-z_]*
  |<=>|->|\+\+|--|&&|\|\||<<=|>>=|<<|<=|>=|==|!=|\+=|-=|\*=|/=|::|\s+|.''', re.S | re.X)
KEYWORDS = {'return', 'throw', 'if', 'else', 'for', 'while', 'do', 'switch', 'case', 'break',
            'continue', 'using', 'namespace', 'class', 'struct', 'enum', 'template', 'const',
            'constexpr', 'static', 'auto', 'double', 'int', 'bool', 'void', 'unsigned', 'typedef',
            'default', 'public', 'private', 'protected', 'friend', 'virtual', 'explicit', 'inline',
            'extern', 'mutable', 'try', 'catch', 'delete', 'new', 'goto', 'float', 'char', 'long'}


class Source:
    def __init__(self, text, first, name):
        self.tokens = TOKEN.findall(text)
        self.number = first
        self.name = name
        self.lines = text.split('\n')
        self.mutants = []
        self.before = [''] * (len(self.tokens) + 1)  # inserted before a token
        self.line = []
        at = 1
        for token in self.tokens:
            self.line.append(at)
            at += token.count('\n')

    def new(self, i, kind):
        number = self.number
        self.number += 1
        self.mutants.append((number, self.name, self.line[i], kind,
                             self.lines[self.line[i] - 1].strip()))
        return number

    def solid(self, i, step):
        """The next token that is neither blank nor comment."""
        i += step
        while 0 <= i < len(self.tokens) and (self.tokens[i].isspace() or
                                             self.tokens[i].startswith(('//', '/*'))):
            i += step
        return i

    def spaced(self, i):
        return (0 < i < len(self.tokens) - 1 and self.tokens[i - 1].isspace() and
                self.tokens[i + 1].isspace())

    def match(self, i):
        """Of an opening bracket its closing one."""
        depth = 0
        while i < len(self.tokens):
            if self.tokens[i] in '([{' and len(self.tokens[i]) == 1:
                depth += 1
            elif self.tokens[i] in CLOSING:
                depth -= 1
                if depth == 0:
                    return i
            i += 1
        return i

    def in_function(self, i):
        return self.inside[i]

    def find_functions(self):
        """Tokens within the body of a function: in a brace that a parenthesis, const, noexcept,
        override, or an initializer goes before."""
        self.inside = [False] * len(self.tokens)
        self.parentheses = [0] * len(self.tokens)  # open ones within the innermost brace
        stack = []
        open_ones = [0]
        for i, token in enumerate(self.tokens):
            if token == '{':
                open_ones.append(0)
            elif token == '}' and len(open_ones) > 1:
                open_ones.pop()
            elif token in ('(', '['):
                open_ones[-1] += 1
            elif token in (')', ']'):
                open_ones[-1] -= 1
            self.parentheses[i] = open_ones[-1]
            if token == '{':
                j = self.solid(i, -1)
                before = self.tokens[j] if j >= 0 else ''
                body = before in (')', 'const', 'noexcept', 'override', 'else', 'do', 'try', '}')
                stack.append((stack[-1] if stack else False) or body)
            elif token == '}' and stack:
                stack.pop()
            self.inside[i] = bool(stack and stack[-1])

    def rewrite(self):
        self.find_functions()
        out = list(self.tokens)
        after = [''] * len(self.tokens)
        before = [''] * len(self.tokens)
        skip_until = -1
        in_template = self.template_arguments()
        for i, token in enumerate(self.tokens):
            if i < skip_until or not self.inside[i]:
                continue
            if token in ('static_assert', 'constexpr', 'template', 'case', 'operator', 'sizeof'):
                skip_until = i
                while skip_until < len(self.tokens) and self.tokens[skip_until] not in (';', '{',
                                                                                        ':'):
                    skip_until += 1
                continue
            if token in RELATIONS and self.spaced(i):
                # Of two optionals the library's own comparison is as good a match.
                if 'position' in self.tokens[self.solid(i, 1)] and token == '==':
                    continue
                number = self.new(i, 'relation ' + token)
                which = f'::mutant::Relational<::mutant::Relation::{RELATIONS[token]}>{{{number}}}'
                out[i] = f'== {which} ==' if token in ('==', '!=') else f'< {which} >'
            elif token in SUMS and self.spaced(i) and self.binary(i):
                number = self.new(i, 'sum ' + token)
                out[i] = f'+ ::mutant::Summing<::mutant::Sum::{SUMS[token]}>{{{number}}} +'
            elif token in PRODUCTS and self.spaced(i) and self.binary(i):
                number = self.new(i, 'product ' + token)
                out[i] = (f'* ::mutant::Multiplying<::mutant::Product::{PRODUCTS[token]}>'
                          f'{{{number}}} *')
            elif token in ('&&', '||') and self.spaced(i):
                end = self.right_end(i)
                begin = self.left_begin(i)
                if end is None or begin is None:
                    continue
                right = self.new(i, 'operand right of ' + token)
                left = self.new(i, 'operand left of ' + token)
                # An operand that is not there: true of a conjunction, false of the other.
                word = (f'(::mutant::is({{}}) || (', '))') if token == '&&' else (
                    f'(!::mutant::is({{}}) && (', '))')
                before[i + 1] = ' ' + word[0].format(right)
                after[end - 1] = word[1] + after[end - 1]
                before[begin] += word[0].format(left)
                after[self.solid(i, -1)] += word[1]
            elif token == 'if' and self.tokens[self.solid(i, 1)] == '(':
                opening = self.solid(i, 1)
                closing = self.match(opening)
                inner = self.tokens[opening + 1:closing]
                text = ''.join(inner)
                if ';' in inner or re.search(r'[^=!<>]=[^=]', text):  # a declaration
                    continue
                number = self.new(i, 'condition')
                after[opening] += f'::mutant::is({number}) != static_cast<bool>('
                before[closing] = ')' + before[closing]
            elif token == ';':
                self.statement(i, before, after)
            elif re.fullmatch(r"\d[\d']*(\.\d*)?([eE][-+]?\d+)?", token):
                previous = self.tokens[self.solid(i, -1)]
                if previous in ('[', 'case') or self.tokens[i + 1] == ']' or i in in_template:
                    continue  # an array's size, a template's argument
                number = self.new(i, 'number')
                out[i] = f'::mutant::number({number}, {token})'
        text = ''.join(b + t + a for b, t, a in zip(before, out, after))
        return '#include "tests/mutation/mutant.h"\n' + text

    def template_arguments(self):
        """The tokens between < and > that stand close to what they enclose."""
        arguments = set()
        for i, token in enumerate(self.tokens):
            if token != '<' or self.spaced(i):
                continue
            depth = 0
            for j in range(i, min(i + 200, len(self.tokens))):
                depth += (self.tokens[j] == '<') - (self.tokens[j] == '>')
                depth -= 2 * (self.tokens[j] == '>>')
                if depth <= 0:
                    arguments.update(range(i, j))
                    break
                if self.tokens[j] in (';', '{'):
                    break
        return arguments

    def binary(self, i):
        previous = self.tokens[self.solid(i, -1)]
        return (previous in (')', ']') or re.match(r"[\w\"']", previous) is not None) and \
            previous not in KEYWORDS and not self.tokens[self.solid(i, 1)].startswith('"') and \
            not previous.endswith('"') and not (previous == ')' and self.makes_text(i))

    def makes_text(self, i):
        """Whether what ends before token i is std::string(...), or a choice of texts: these have no
        difference."""
        depth = 0
        j = self.solid(i, -1)
        while j > 0:
            depth += (self.tokens[j] == ')') - (self.tokens[j] == '(')
            if depth == 0:
                return self.tokens[j - 1] == 'string'
            if depth == 1 and self.tokens[j].startswith('"'):
                return True
            j -= 1
        return False

    def right_end(self, i):
        depth = 0
        j = i + 1
        while j < len(self.tokens):
            token = self.tokens[j]
            if token in ('(', '[', '{'):
                j = self.match(j)
            elif token in (')', ']', '}', ';', ',', '?', '&&', '||', ':') and depth == 0:
                return self.solid(j, -1) + 1
            j += 1
        return None

    def left_begin(self, i):
        j = i - 1
        depth = 0
        while j >= 0:
            token = self.tokens[j]
            if token in CLOSING:
                depth += 1
            elif token in ('(', '[', '{'):
                if depth == 0:
                    return self.solid(j, 1)
                depth -= 1
            elif depth == 0 and token in ('&&', '||', ';', ',', '?', ':', '=', 'return'):
                return self.solid(j, 1)
            j -= 1
        return None

    def statement(self, i, before, after):
        """A statement that is a call or an assignment: it is left out."""
        if self.parentheses[i] > 0:  # of a for-loop's header
            return
        j = i - 1
        depth = 0
        while j >= 0:
            token = self.tokens[j]
            if token in CLOSING:
                if token == '}' and depth == 0:
                    break
                depth += 1
            elif token in ('(', '[', '{'):
                if depth == 0:
                    break
                depth -= 1
            elif token == ';' and depth == 0:
                break
            j -= 1
        first = self.solid(j, 1)
        if self.tokens[j] not in (';', '{', '}') or first >= i:
            return
        words = [t for t in self.tokens[first:i] if not t.isspace()]
        # "Type name = ..." and "Type name(...)" are declarations.
        if words[0] in KEYWORDS or not re.match(r'[A-Za-z_+*-]', words[0]):
            return
        text = ''.join(self.tokens[first:i])
        if re.match(r'[A-Za-z_][\w:]*(<[^;=]*>)?[&*]?(\s+const)?\s+[&*]?[A-Za-z_]\w*\s*([={(;]|$)',
                    text):
            return
        if re.match(r'[A-Za-z_][\w:]*<', text) or 'mutant' in text:
            return
        number = self.new(first, 'statement')
        before[first] = f'if (!::mutant::is({number})) {{ ' + before[first]
        after[i] += ' }'


def main():
    first, name, output, listing = int(sys.argv[1]), sys.argv[2], sys.argv[3], sys.argv[4]
    with open(name, encoding='utf-8') as file:
        source = Source(file.read(), first, name)
    text = source.rewrite()
    with open(output, 'w', encoding='utf-8') as file:
        file.write(text)
    with open(listing, 'w', encoding='utf-8') as file:
        for mutant in source.mutants:
            file.write('\t'.join(str(part) for part in mutant) + '\n')


if __name__ == '__main__':
    main()
