// Rules by which Foxglove's open code and Lichtblick take or refuse a topic, and the schemas that
// they know by name, as the package @foxglove/schemas has them.
// SPDX-License-Identifier: Apache-2.0
import Ajv from "ajv";
import * as reference from "@foxglove/schemas/jsonschema.js";

const ajv = new Ajv({ strict: false });

/** What the readers' own parser of JSON Schema would refuse (packages/mcap-support in both): it
 * wants an object at the top, one plain type a field, numbers in oneOf, base64 or no encoding. */
export function refusals(schema, path = "") {
  const found = [];
  if (schema?.type !== "object") return [`${path || "."}: is no object`];
  if (typeof schema.properties !== "object") return [`${path || "."}: has no properties`];
  for (const [name, field] of Object.entries(schema.properties)) {
    const at = `${path}.${name}`;
    if (Array.isArray(field.oneOf)) {
      if (!field.oneOf.every((one) => typeof one.const === "number"))
        found.push(`${at}: oneOf without numbers`);
    } else if (field.type === "object") {
      found.push(...refusals(field, at));
    } else if (field.type === "array") {
      const item = field.items ?? {};
      if (item.type === "object") found.push(...refusals(item, `${at}[]`));
      else if (!["boolean", "string", "number", "integer"].includes(item.type))
        found.push(`${at}[]: unsupported type ${JSON.stringify(item.type)}`);
      else if (item.contentEncoding !== undefined) found.push(`${at}[]: encoded`);
    } else if (!["boolean", "string", "number", "integer"].includes(field.type)) {
      found.push(`${at}: unsupported type ${JSON.stringify(field.type)}`);
    } else if (![undefined, "base64"].includes(field.contentEncoding)) {
      found.push(`${at}: unknown encoding`);
    }
  }
  return found;
}

/** A schema without its texts: what is left decides how messages are read. */
export function shape(schema) {
  if (Array.isArray(schema)) return schema.map(shape);
  if (schema === null || typeof schema !== "object") return schema;
  const kept = {};
  for (const key of Object.keys(schema).sort())
    if (key !== "description" && key !== "$comment")
      kept[key] = key === "required" ? [...schema[key]].sort() : shape(schema[key]);
  return kept;
}

/** The schema of that name in the package; undefined for a name of our own. */
export function known(name) {
  if (!name.startsWith("foxglove.")) return undefined;
  const schema = reference[name.slice("foxglove.".length)];
  if (schema === undefined) throw new Error(`${name}: the package has no such schema`);
  return schema;
}

/** A function from a message to what is wrong with it ("" when nothing is). Of our own names the
 * schema in the file holds, and no field beyond it. */
export function judge(name, schema) {
  const check = ajv.compile(known(name) ?? { ...schema, additionalProperties: false });
  return (message) => (check(message) ? "" : ajv.errorsText(check.errors));
}

/** Everything wrong with a topic's schema. */
export function schema_faults(name, schema) {
  const faults = refusals(schema);
  const model = known(name);
  if (model && JSON.stringify(shape(model)) !== JSON.stringify(shape(schema)))
    faults.push(`differs from ${name} of @foxglove/schemas`);
  return faults;
}
