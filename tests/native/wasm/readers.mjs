// Surfaces of mesh files: node readers.mjs MODULE FILES prints a line of JSON for each, its corners or its fault.
// FILES is JSON, [[name, base64], ...]. See tests/mesh/test_page_readers.py.
import { readFileSync } from "node:fs";
import { readMesh } from "rastercov/mesh_file.js";

const module = readFileSync(process.argv[2]);
for (const [name, content] of JSON.parse(readFileSync(process.argv[3]))) {
  try {
    const bytes = new Uint8Array(Buffer.from(content, "base64"));
    const { vertices, faces, groupOf, groups, notes } = await readMesh(name, bytes, () => module);
    const corners = [...faces].flatMap((corner) => [...vertices.subarray(3 * corner, 3 * corner + 3)].map(String));
    const names = groups.map((each) => each.name);
    console.log(JSON.stringify({ corners, groupOf: [...groupOf], groups: names, notes }));
  } catch (error) {
    console.log(JSON.stringify({ fault: error.message, status: error.status ?? 0 }));
  }
}
