# The batch tracing kernel is one source compiled per CPU level; optics/rays/batch.cpp chooses at run time.
set(kernel_options -O3 -fno-math-errno -fno-trapping-math -ffp-contract=off)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # Threaded jumps would leave branches in the loops, which SSE2 cannot turn into vectors.
  list(APPEND kernel_options -fno-thread-jumps -fno-ssa-phiopt)
endif()
set_property(SOURCE optics/rays/batch_kernel_baseline.cpp PROPERTY COMPILE_OPTIONS ${kernel_options})
set_property(SOURCE optics/rays/batch_kernel_avx2.cpp PROPERTY COMPILE_OPTIONS ${kernel_options} -mavx2)
set_property(SOURCE optics/rays/batch_kernel_avx512.cpp PROPERTY COMPILE_OPTIONS ${kernel_options}
             -mavx512f -mavx512dq -mavx512vl -mprefer-vector-width=512)
set_source_files_properties(optics/rays/batch_kernel_baseline.cpp optics/rays/batch_kernel_avx2.cpp
             optics/rays/batch_kernel_avx512.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON
                            SKIP_UNITY_BUILD_INCLUSION ON)  # compiled with other options
