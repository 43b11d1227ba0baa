# guid_of_sources(RESULT FILE...): "{...}", a hash of the names and contents of the sources
function(guid_of_sources result)
  set(text "")
  foreach(file ${ARGN})
    file(SHA256 ${file} hash)
    file(RELATIVE_PATH path ${CMAKE_SOURCE_DIR} ${file})
    string(APPEND text "${path} ${hash}\n")
  endforeach()
  string(UUID uuid NAMESPACE 6ba7b812-9dad-11d1-80b4-00c04fd430c8 NAME "${text}" TYPE SHA1) # namespace OID, RFC 4122
  set(${result} "{${uuid}}" PARENT_SCOPE)
endfunction()
