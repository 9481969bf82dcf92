// Vertices of the mesh to clip space, one pose an instance.
//
// Positions come as two floats each, high + low, and so does the eye. Their difference is taken
// before anything is rounded to one float, so a part at 10^7 m projects as it does at the origin.

#ifdef LAYERED
#extension GL_ARB_shader_viewport_layer_array : enable
#extension GL_AMD_vertex_shader_layer : enable
#endif

struct Pose {
    vec4 right, down, forward;  // rows of camera_from_world; the first two mixed to roll the samples
    vec4 eye_high, eye_low;
    vec4 depth;                 // clip z = depth.x * z + depth.y
};

layout(std140) uniform Poses { Pose poses[MAX_POSES]; };

uniform int first_pose;
uniform vec4 image;  // clip x = image.x * x + image.z * z, clip y = image.y * y + image.w * z

in vec3 position_high;
in vec3 position_low;

// Face index + 1. A face takes it from its last corner, and the vertex of that number is the last
// corner of no other face. (gl_PrimitiveID would do, but Mesa takes primitives apart to number them.)
flat out uint id;

#ifdef LAYERED
flat out int layer;
#endif

void main() {
    Pose pose = poses[first_pose + gl_InstanceID];
    vec3 from_eye = (position_high - pose.eye_high.xyz) + (position_low - pose.eye_low.xyz);
    float x = dot(pose.right.xyz, from_eye);
    float y = dot(pose.down.xyz, from_eye);
    float z = dot(pose.forward.xyz, from_eye);
    // Image rows run down, and so do the rows of our framebuffers: no flip anywhere.
    gl_Position = vec4(image.x * x + image.z * z,
                       image.y * y + image.w * z,
                       pose.depth.x * z + pose.depth.y,
                       z);
    id = uint(gl_VertexID) + 1u;
#ifdef LAYERED
    layer = gl_InstanceID;
    gl_Layer = gl_InstanceID;
#endif
}
