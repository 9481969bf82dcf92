// Transforms the vertices of the mesh to clip space.
//
// Positions and the eye (camera centre) are sums of two floats, high + low. They are subtracted
// before rounding to one float, so a part at 10^7 m projects as at the origin.
//
// COPLANAR is for overlapping coplanar faces, whose depth is computed from their plane, as on the
// CPU, instead of interpolated. In double precision 1/z is affine in the image, and on two faces of
// one plane it rounds to the same float.

struct Pose {
    vec4 right, down, forward;  // camera axes; right and down mixed to rotate the grid
    vec4 eye_high, eye_low;
    vec4 near;                  // clip z = x + y z, clip w = z z + w; of a pinhole z, else 1
};

layout(std140) uniform Poses { Pose pose; };

uniform vec4 image;  // clip x = image.x * x + image.z * w, clip y = image.y * y + image.w * w

in vec3 position_high;
in vec3 position_low;

// Every program places the corners of a face alike, so edges stay watertight.
invariant gl_Position;

#ifdef COPLANAR
// The ray through the point (x, y) of the canvas is x right + y down + ahead at depth 1.
struct Ray {
    dvec4 right, down, forward;  // depth in the buffer is right.w / z; of parallel rays, where
                                 // forward.w is not 0, right.w (forward.w - z)
    dvec4 eye;                   // relative to the centre of the mesh
};

layout(std140) uniform Rays { Ray ray; };

uniform ivec2 corner;   // top-left of this image on the canvas
uniform dvec2 middle;   // cx, cy in samples

in uint number;         // index + 1 of the face whose last corner this is,
in dvec3 corner_a;      // its corners
in dvec3 corner_b;
in dvec3 corner_c;
in dvec3 normal;        // and its normal, of any length

flat out dvec3 plane;   // depth in the buffer = plane.x x + plane.y y + plane.z
flat out vec2 reach;    // least and greatest depth in the buffer of its corners
#endif

// Face index + 1, taken from the last corner of a face: vertex f is the last corner of face f alone.
// gl_PrimitiveID would be simpler, but Mesa splits primitives to number them.
flat out uint id;


#ifdef COPLANAR
// Rays start at x right + y down and run along forward.
void find_parallel_plane(dvec3 a, double nearest, double farthest) {
    double scale = ray.right.w, farther = ray.forward.w;
    reach = vec2(scale * (farther - farthest), min(1.0lf, scale * (farther - nearest)));

    precise double height = dot(normal, a);
    precise double x = dot(normal, ray.right.xyz), y = dot(normal, ray.down.xyz);
    double ahead = dot(normal, ray.forward.xyz);  // 0 edge-on: the farthest depth of its corners
    double per = ahead == 0.0lf ? 0.0lf : scale / ahead;
    precise double offset = height + (middle.x - double(corner.x)) * x + (middle.y - double(corner.y)) * y;
    plane = dvec3(per * x, per * y, ahead == 0.0lf ? 0.0lf : scale * farther - per * offset);
}

void find_plane() {
    dvec3 a = corner_a - ray.eye.xyz, b = corner_b - ray.eye.xyz, c = corner_c - ray.eye.xyz;
    dvec3 z = dvec3(dot(ray.forward.xyz, a), dot(ray.forward.xyz, b), dot(ray.forward.xyz, c));
    double nearest = min(z.x, min(z.y, z.z)), farthest = max(z.x, max(z.y, z.z));
    if (ray.forward.w != 0.0lf) {
        find_parallel_plane(a, nearest, farthest);
        return;
    }
    // A face that reaches behind the eye has no nearest corner; it is cut at the near plane.
    float first = nearest > 0.0lf ? float(ray.right.w / nearest) : 1.0;
    float last = float(ray.right.w / max(farthest, nearest));
    reach = vec2(min(first, last), max(first, last));

    precise double height = dot(normal, a);  // offset of the plane from the eye
    precise double x = dot(normal, ray.right.xyz), y = dot(normal, ray.down.xyz);
    precise double ahead = dot(normal, ray.forward.xyz) - middle.x * x - middle.y * y;
    // From an eye in the plane the face is a line, and may cover a sample by rounding: scale 0 gives
    // it the farthest depth, clamped to that of its corners.
    double scale = height == 0.0lf ? 0.0lf : ray.right.w / height;
    plane = scale * dvec3(x, y, ahead + double(corner.x) * x + double(corner.y) * y);
}
#endif

void main() {
    vec3 from_eye = (position_high - pose.eye_high.xyz) + (position_low - pose.eye_low.xyz);
    float x = dot(pose.right.xyz, from_eye);
    float y = dot(pose.down.xyz, from_eye);
    float z = dot(pose.forward.xyz, from_eye);
    // Rows of images and of our framebuffers both run down, so nothing is flipped.
    float w = pose.near.z * z + pose.near.w;
    gl_Position = vec4(image.x * x + image.z * w,
                       image.y * y + image.w * w,
                       pose.near.x + pose.near.y * z,
                       w);
#ifdef COPLANAR
    id = number;
    find_plane();
#else
    id = uint(gl_VertexID) + 1u;
#endif
}
