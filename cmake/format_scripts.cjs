// Lays out Lua files with StyLua (its WASM build, of the version in tests/page/package-lock.json). Arguments: the folder with
// its node_modules, --check to be told only which differ, files.
// SPDX-License-Identifier: Apache-2.0
const { readFileSync, writeFileSync } = require('fs');
const [stylua_folder, ...rest] = process.argv.slice(2);
const stylua = require(`${stylua_folder}/node_modules/@johnnymorganz/stylua`);
const check = rest[0] === '--check';
let different = 0;
for (const file of check ? rest.slice(1) : rest) {
  const config = stylua.Config.new(); // a call takes it away
  config.column_width = 130;
  config.indent_type = stylua.IndentType.Spaces;
  config.indent_width = 2;
  config.syntax = stylua.LuaVersion.Lua54;
  config.collapse_simple_statement = stylua.CollapseSimpleStatement.Always;
  config.call_parentheses = stylua.CallParenType.Input;
  const text = readFileSync(file, 'utf8');
  const laid_out = stylua.formatCode(text, config, undefined, stylua.OutputVerification.Full);
  if (laid_out === text) continue;
  different += 1;
  console.log(file);
  if (!check) writeFileSync(file, laid_out);
}
process.exit(check && different > 0 ? 1 : 0);
