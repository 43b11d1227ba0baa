# add_fmu(NAME): fmus/NAME/{model.def, equations.c} -> build/fmus/NAME.fmu
#   table, equations, glue -> GUID
#   table -> describe (built and run here) -> modelDescription.xml, documentation/index.html
#   table + equations + glue -> binaries/PLATFORM/NAME
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

set(STRIPPED -Wl,-s)
if(APPLE)
  set(STRIPPED -Wl,-x)
endif()

set(FMU_OUTPUT_DIR ${CMAKE_BINARY_DIR}/fmus)
file(MAKE_DIRECTORY ${FMU_OUTPUT_DIR})
file(GLOB FMI2_GLUE CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/fmus/fmi2/*.[ch] ${CMAKE_SOURCE_DIR}/fmus/fmi2/*.def)
file(GLOB FRICTION CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/fmus/friction/*)

function(add_fmu name)
  set(source ${CMAKE_SOURCE_DIR}/fmus/${name})
  set(tree ${CMAKE_BINARY_DIR}/units/${name})
  file(GLOB physics CONFIGURE_DEPENDS ${source}/*.c ${source}/*.h ${source}/*.def)
  file(MAKE_DIRECTORY ${tree}/fmu/sources/fmi2 ${tree}/fmu/sources/friction ${tree}/fmu/sources/${name} ${tree}/fmu/documentation
       ${tree}/fmu/binaries/${FMI_PLATFORM})
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${physics} ${FMI2_GLUE} ${FRICTION})
  guid_of_sources(guid ${physics} ${FMI2_GLUE} ${FRICTION})
  # compiled from here, shipped from there: beside the shipped one lie copies of the glue, which may be older
  set(prefix "")
  configure_file(${CMAKE_SOURCE_DIR}/cmake/all.c.in ${tree}/all.c @ONLY)
  # FMI 2.0.4, 2.1.1: sources that are linked with other units' carry the name of theirs
  set(prefix "#define FMI2_FUNCTION_PREFIX ${name}_\n")
  configure_file(${CMAKE_SOURCE_DIR}/cmake/all.c.in ${tree}/fmu/sources/all.c @ONLY)
  configure_file(${CMAKE_SOURCE_DIR}/cmake/buildDescription.xml.in ${tree}/fmu/sources/buildDescription.xml @ONLY)

  add_library(${name} MODULE ${tree}/all.c)
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR}/fmus ${FMI2_INCLUDE_DIR})
  set_source_files_properties(${tree}/all.c PROPERTIES OBJECT_DEPENDS "${physics};${FMI2_GLUE};${FRICTION}")
  set_target_properties(${name} PROPERTIES PREFIX "" C_VISIBILITY_PRESET hidden LIBRARY_OUTPUT_DIRECTORY ${tree}/fmu/binaries/${FMI_PLATFORM}
                                           RUNTIME_OUTPUT_DIRECTORY ${tree}/fmu/binaries/${FMI_PLATFORM})
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

  add_executable(describe_${name} ${CMAKE_SOURCE_DIR}/fmus/fmi2/describe.c)
  target_include_directories(describe_${name} PRIVATE ${CMAKE_SOURCE_DIR}/fmus)
  target_compile_definitions(describe_${name} PRIVATE MODEL_DEF="${name}/model.def" UNIT_GUID="${guid}")
  if(NOT MSVC)
    target_compile_options(describe_${name} PRIVATE -O0 -Wno-unused-function)
    target_link_libraries(describe_${name} PRIVATE m)
  endif()
  set_property(SOURCE ${CMAKE_SOURCE_DIR}/fmus/fmi2/describe.c APPEND PROPERTY OBJECT_DEPENDS "${physics};${FMI2_GLUE};${FRICTION}")

  set(icon ${source}/model.png)
  add_custom_command(
    OUTPUT ${FMU_OUTPUT_DIR}/${name}.fmu
    COMMAND describe_${name} xml ${PROJECT_VERSION} > ${tree}/fmu/modelDescription.xml
    COMMAND describe_${name} html ${PROJECT_VERSION} > ${tree}/fmu/documentation/index.html
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${FMI2_GLUE} ${tree}/fmu/sources/fmi2
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${FRICTION} ${tree}/fmu/sources/friction
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${physics} ${tree}/fmu/sources/${name}
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${CMAKE_SOURCE_DIR}/LICENSE ${tree}/fmu/documentation
    COMMAND ${CMAKE_COMMAND} -E copy_if_different ${icon} ${tree}/fmu
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/pack.py ${tree}/fmu ${FMU_OUTPUT_DIR}/${name}.fmu
    DEPENDS ${name} describe_${name} ${physics} ${FMI2_GLUE} ${FRICTION} ${icon} ${CMAKE_SOURCE_DIR}/orchestrator/cobot_joint/pack.py
            ${tree}/fmu/sources/all.c ${tree}/fmu/sources/buildDescription.xml
    COMMAND_EXPAND_LISTS VERBATIM
    COMMENT "${name}.fmu")
  add_custom_target(${name}_fmu ALL DEPENDS ${FMU_OUTPUT_DIR}/${name}.fmu)
endfunction()
