// Surfaces of mesh files: node readers.mjs FILES prints a line of JSON for each, its corners or its fault. FILES
// is JSON, [[name, base64], ...]. See tests/mesh/test_page_readers.py.
import { readFileSync } from "node:fs";
import { readMesh } from "rastercov/mesh_file.js";

for (const [name, content] of JSON.parse(readFileSync(process.argv[2]))) {
  try {
    const { vertices, faces, groups, notes } = readMesh(name, new Uint8Array(Buffer.from(content, "base64")));
    const corners = [...faces].flatMap((corner) => [...vertices.subarray(3 * corner, 3 * corner + 3)].map(String));
    console.log(JSON.stringify({ corners, groups: groups.map((each) => each.name), notes }));
  } catch (error) {
    console.log(JSON.stringify({ fault: error.message, status: error.status ?? 0 }));
  }
}
