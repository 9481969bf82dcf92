# Language, flags of the loops and levels of processors, for the modules of Python and for the
# library of C.
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS ON) # vector extensions
set(CMAKE_CXX_SCAN_FOR_MODULES OFF) # there are none
find_program(CCACHE ccache)
if(CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE})
endif()

option(RASTERCOV_WERROR "warnings are errors" OFF)

# Equal bits on all levels and by all compilers: no contraction to fused operations, no fast-math.
set(FLAGS -ffp-contract=off -fno-math-errno -fno-trapping-math
  -Wall -Wextra -Wno-psabi -Wno-unused-parameter
  $<$<CXX_COMPILER_ID:Clang,AppleClang>:-Wno-bitwise-instead-of-logical> # without a branch, on purpose
  $<$<BOOL:${RASTERCOV_WERROR}>:-Werror>
  -Wno-uninitialized $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>) # of the intrinsics of GCC 12 themselves
set(FLAGS_v2 -msse4.2 -mpopcnt)
# No -mfma: GCC 12 fuses a product with alternating sums and differences (vfmaddsub) in spite of
# -ffp-contract=off.
set(FLAGS_v3 ${FLAGS_v2} -mavx2 -mbmi -mbmi2 -mf16c -mlzcnt -mmovbe)
set(FLAGS_v4 ${FLAGS_v3} -mavx512f -mavx512bw -mavx512cd -mavx512dq -mavx512vl)
# AVX-512 includes the fused operations: here without the pass of GCC that makes vfmaddsub of single
# numbers. Elsewhere it makes none, and certified areas of 1,000,000 faces take 13 % less time by
# it.
set_source_files_properties(${CMAKE_CURRENT_LIST_DIR}/area/cut.cpp
  ${CMAKE_CURRENT_LIST_DIR}/lens/edge_bounds.cpp PROPERTIES
  COMPILE_OPTIONS $<$<CXX_COMPILER_ID:GNU>:-fno-tree-slp-vectorize>)
set(FLAGS_generic)
if("${CMAKE_OSX_ARCHITECTURES};${CMAKE_SYSTEM_PROCESSOR}" MATCHES "^;?(x86_64|AMD64)")
  set(KNOWN v2 v3 v4)
else()
  set(KNOWN generic)
endif()

# Levels of this machine, by the code that chooses one at load.
if(CMAKE_CROSSCOMPILING)
  set(RUNNABLE ${KNOWN})
else()
  try_run(OWN_LEVEL COMPILED ${CMAKE_CURRENT_BINARY_DIR}/probe
    SOURCES ${CMAKE_CURRENT_LIST_DIR}/cpu.cpp
    COMPILE_DEFINITIONS -DRASTERCOV_PROBE)
  set(RUNNABLE)
  foreach(level IN LISTS KNOWN)
    string(REPLACE v "" number ${level})
    if(level STREQUAL "generic" OR NOT number GREATER OWN_LEVEL)
      list(APPEND RUNNABLE ${level})
    endif()
  endforeach()
  if(NOT RUNNABLE)
    message(FATAL_ERROR "rastercov needs a processor of x86-64-v2 (2009) or later")
  endif()
endif()
list(GET RUNNABLE -1 OWN)
