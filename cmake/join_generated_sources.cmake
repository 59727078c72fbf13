# The generated C++ of all messages includes the same large headers: joined by nines, it compiles in a quarter of the time.
function(join_generated_sources package)
  foreach(kind introspection_cpp fastrtps_c fastrtps_cpp c cpp)
    set(target ${package}__rosidl_typesupport_${kind})
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 9)
      target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU,Clang>:-Wno-redundant-decls>)  # each file declares what it uses
    endif()
  endforeach()
endfunction()
