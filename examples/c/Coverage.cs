// Area of a square that a camera above it covers, from C#.
//   make lib && mcs examples/c/Coverage.cs && LD_LIBRARY_PATH=build/lib mono examples/c/Coverage.exe
using System;
using System.Runtime.InteropServices;

[StructLayout(LayoutKind.Sequential)]
struct Camera {
    public int size;
    public double width, height, fx, fy, cx, cy, near;
    public IntPtr lens;
    public int isParallel;
}

[StructLayout(LayoutKind.Sequential)]
struct Task {
    public double minDepth, maxDepth, maxIncidenceDeg;
    public double minPixelDensity, minFacingDensity, minPixelsPerM2;
}

static class Coverage {
    const string Library = "librastercov.so";
    [DllImport(Library)]
    static extern int rc_surface_create(double[] vertices, long nVertices, int[] faces, long nFaces,
                                        byte[] roles, out IntPtr surface);
    [DllImport(Library)]
    static extern int rc_solver_create(IntPtr surface, int method, int nThreads, out IntPtr solver);
    [DllImport(Library)]
    static extern Task rc_task_default();
    [DllImport(Library)]
    static extern int rc_look_at(double[] eye, double[] target, double[] up, double[] pose);
    [DllImport(Library)]
    static extern int rc_find_regions(IntPtr solver, ref Camera camera, ref Task task,
                                      double[] poses, long nPoses, IntPtr goOn, IntPtr context,
                                      out IntPtr regions);
    [DllImport(Library)]
    static extern int rc_regions_areas(IntPtr regions, long pose, long nPoses, long nFaces,
                                       double[] areas, double[] bounds);
    [DllImport(Library)]
    static extern IntPtr rc_last_error();

    static void Check(int status) {
        if (status != 0) throw new Exception(Marshal.PtrToStringAnsi(rc_last_error()));
    }

    static void Main() {
        IntPtr surface, solver, regions;
        var vertices = new double[] { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
        var faces = new int[] { 0, 1, 2, 0, 2, 3 };
        Check(rc_surface_create(vertices, 4, faces, 2, null, out surface));
        Check(rc_solver_create(surface, 0, 1, out solver));
        var camera = new Camera { size = Marshal.SizeOf(typeof(Camera)), width = 640, height = 480,
                                  fx = 800, fy = 800, cx = 320, cy = 240 };
        var task = rc_task_default();
        var pose = new double[16];
        Check(rc_look_at(new double[] { 0.5, 0.5, 4 }, new double[] { 0.5, 0.5, 0 }, null, pose));
        Check(rc_find_regions(solver, ref camera, ref task, pose, 1, IntPtr.Zero, IntPtr.Zero,
                              out regions));
        var areas = new double[2];
        var bounds = new double[2];
        Check(rc_regions_areas(regions, 0, 1, 2, areas, bounds));
        Console.WriteLine("the camera covers {0:F9} m2", areas[0] + areas[1]);
    }
}
