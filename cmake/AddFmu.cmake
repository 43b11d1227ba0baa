# add_fmu(NAME): fmus/NAME/{model.def, equations.c} -> build/fmus/NAME.fmu (FMI 2.0), build/fmus/fmi3/NAME.fmu (FMI 3.0)
#   table, equations, glue -> GUID
#   table -> describe (built and run here) -> modelDescription.xml, documentation/index.html (its equations typeset by mathml.py)
#   table + equations + glue -> one library with the functions of both, in both
include(${CMAKE_CURRENT_LIST_DIR}/Guid.cmake)

if(CMAKE_SYSTEM_NAME STREQUAL "Windows")
  set(FMI_PLATFORM win64)
elseif(CMAKE_SYSTEM_NAME STREQUAL "Darwin")
  set(FMI_PLATFORM darwin64)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  set(FMI_PLATFORM aarch64-linux)
else()
  set(FMI_PLATFORM linux64)
endif()

# FMI 3.0.2, 2.5.1.4.1: architecture and system
set(FMI3_PLATFORM_linux64 x86_64-linux)
set(FMI3_PLATFORM_aarch64-linux aarch64-linux)
set(FMI3_PLATFORM_win64 x86_64-windows)
set(FMI3_PLATFORM_darwin64 x86_64-darwin)
if(APPLE AND CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  set(FMI3_PLATFORM_darwin64 aarch64-darwin)
endif()

set(STRIPPED -Wl,-s)
if(APPLE)
  set(STRIPPED -Wl,-x)
endif()

set(FMU_OUTPUT_DIR ${CMAKE_BINARY_DIR}/fmus)
file(MAKE_DIRECTORY ${FMU_OUTPUT_DIR}/fmi3)
file(GLOB GLUE CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/fmus/core/*.h ${CMAKE_SOURCE_DIR}/fmus/fmi[23]/*.[ch] ${CMAKE_SOURCE_DIR}/fmus/describe/*)
file(GLOB FRICTION CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/fmus/friction/*)

function(add_fmu name)
  set(source ${CMAKE_SOURCE_DIR}/fmus/${name})
  set(tree ${CMAKE_BINARY_DIR}/units/${name})
  file(GLOB physics CONFIGURE_DEPENDS ${source}/*.c ${source}/*.h ${source}/*.def)
  file(MAKE_DIRECTORY ${tree})
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${physics} ${GLUE} ${FRICTION})
  guid_of_sources(guid ${physics} ${GLUE} ${FRICTION})
  set(prefix "")
  set(adapters "#include \"fmi2/fmi2.c\"\n#include \"fmi3/fmi3.c\"\n")
  configure_file(${CMAKE_SOURCE_DIR}/cmake/all.c.in ${tree}/all.c @ONLY)

  add_library(${name} MODULE ${tree}/all.c)
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR}/fmus ${FMI_INCLUDE_DIR})
  set_source_files_properties(${tree}/all.c PROPERTIES OBJECT_DEPENDS "${physics};${GLUE};${FRICTION}")
  set_target_properties(${name} PROPERTIES PREFIX "" C_VISIBILITY_PRESET hidden LIBRARY_OUTPUT_DIRECTORY ${tree} RUNTIME_OUTPUT_DIRECTORY ${tree})
  if(APPLE)
    set_target_properties(${name} PROPERTIES SUFFIX ".dylib")
  endif()
  if(MSVC)
    target_compile_options(${name} PRIVATE /W4)
  else()
    target_compile_options(${name} PRIVATE -O3 -fno-math-errno -fno-trapping-math ${STRICT_WARNINGS})
    target_link_libraries(${name} PRIVATE m)
    target_link_options(${name} PRIVATE $<$<CONFIG:Release>:${STRIPPED}>)
  endif()

  add_executable(describe_${name} ${CMAKE_SOURCE_DIR}/fmus/describe/describe.c)
  target_include_directories(describe_${name} PRIVATE ${CMAKE_SOURCE_DIR}/fmus)
  target_compile_definitions(describe_${name} PRIVATE MODEL_DEF="${name}/model.def" UNIT_GUID="${guid}")
  if(NOT MSVC)
    target_compile_options(describe_${name} PRIVATE -O0 -Wno-unused-function)
    target_link_libraries(describe_${name} PRIVATE m)
  endif()
  set_property(SOURCE ${CMAKE_SOURCE_DIR}/fmus/describe/describe.c APPEND PROPERTY OBJECT_DEPENDS "${physics};${GLUE};${FRICTION}")

  pack_fmu(${name} 2 ${FMI_PLATFORM} ${FMU_OUTPUT_DIR}/${name}.fmu)
  pack_fmu(${name} 3 ${FMI3_PLATFORM_${FMI_PLATFORM}} ${FMU_OUTPUT_DIR}/fmi3/${name}.fmu)
  add_custom_target(${name}_fmu ALL DEPENDS ${FMU_OUTPUT_DIR}/${name}.fmu ${FMU_OUTPUT_DIR}/fmi3/${name}.fmu)
endfunction()

# pack_fmu(NAME FMI PLATFORM FILE): the library of add_fmu, its description and sources for one version of FMI. From add_fmu alone.
function(pack_fmu name fmi platform file)
  set(fmu ${tree}/fmi${fmi})
  file(MAKE_DIRECTORY ${fmu}/sources/core ${fmu}/sources/fmi${fmi} ${fmu}/sources/friction ${fmu}/sources/${name} ${fmu}/documentation
       ${fmu}/binaries/${platform})
  # FMI 2.0.4, 2.1.1; FMI 3.0.2, 2.2.1: sources that are linked with other units' carry the name of theirs
  set(prefix "#define FMI${fmi}_FUNCTION_PREFIX ${name}_\n")
  set(adapters "#include \"fmi${fmi}/fmi${fmi}.c\"\n")
  configure_file(${CMAKE_SOURCE_DIR}/cmake/all.c.in ${fmu}/sources/all.c @ONLY)
  configure_file(${CMAKE_SOURCE_DIR}/cmake/buildDescription.xml.in ${fmu}/sources/buildDescription.xml @ONLY)
  set(core ${GLUE})
  list(FILTER core INCLUDE REGEX "/core/")
  set(adapter ${GLUE})
  list(FILTER adapter INCLUDE REGEX "/fmi${fmi}/")
  set(licence ${fmu}/documentation)
  set(icon ${fmu}/model.png)
  if(fmi EQUAL 3) # FMI 3.0.2, 2.5.1: places of their own
    set(licence ${fmu}/documentation/licenses)
    set(icon ${fmu}/terminalsAndIcons/icon.png)
    file(MAKE_DIRECTORY ${licence} ${fmu}/terminalsAndIcons)
  endif()
  add_custom_command(
    OUTPUT ${file}
    COMMAND describe_${name} xml ${fmi} ${PROJECT_VERSION} > ${fmu}/modelDescription.xml
    COMMAND describe_${name} html ${fmi} ${PROJECT_VERSION} > ${fmu}/documentation/index.html
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/mathml.py ${fmu}/documentation/index.html
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${core} ${fmu}/sources/core
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${adapter} ${fmu}/sources/fmi${fmi}
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${FRICTION} ${fmu}/sources/friction
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${physics} ${fmu}/sources/${name}
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${CMAKE_SOURCE_DIR}/LICENSE ${licence}
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${source}/model.png ${icon}
    COMMAND ${CMAKE_COMMAND} -E copy_if_different $<TARGET_FILE:${name}> ${fmu}/binaries/${platform}
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/pack.py ${fmu} ${file}
    DEPENDS ${name} describe_${name} ${physics} ${GLUE} ${FRICTION} ${source}/model.png ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/pack.py
            ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/mathml.py ${fmu}/sources/all.c ${fmu}/sources/buildDescription.xml
    COMMAND_EXPAND_LISTS VERBATIM
    COMMENT "${name}.fmu, FMI ${fmi}.0")
endfunction()
