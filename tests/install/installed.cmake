# Installs what BUILD has built into FOLDER, each component into its own prefix, and tries what lies there: both
# binaries start, the unit names what is installed, the template of a device compiles, the contract is whole.
file(REMOVE_RECURSE ${FOLDER})
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE status OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(status)
    message(FATAL_ERROR "${ARGV}:\n${said}")
  endif()
endfunction()
function(component_is name)
  run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${FOLDER}/${name} --component ${name})
  file(GLOB_RECURSE files RELATIVE ${FOLDER}/${name} ${FOLDER}/${name}/*)
  list(FILTER files EXCLUDE REGEX "^share/doc/")
  if(NOT files STREQUAL "${ARGN}")
    message(FATAL_ERROR "${name} installs\n${files}\nnot\n${ARGN}")
  endif()
  if(NOT EXISTS ${FOLDER}/${name}/share/doc/teletact-${name}/copyright)
    message(FATAL_ERROR "${name} comes without its licence")
  endif()
endfunction()

component_is(service bin/teletact-service lib/systemd/system/teletact.service)
component_is(client bin/teletact-client)
component_is(dev include/teletact_device.h
  share/teletact/proto/teletact/v1/common.proto share/teletact/proto/teletact/v1/elastography.proto
  share/teletact/proto/teletact/v1/info.proto share/teletact/proto/teletact/v1/palpation.proto
  share/teletact/proto/teletact/v1/recording.proto)

run(${FOLDER}/service/bin/teletact-service --version)
run(${FOLDER}/client/bin/teletact-client --version)
file(STRINGS ${FOLDER}/service/lib/systemd/system/teletact.service start REGEX "^ExecStart=teletact-service serve ")
if(NOT start)
  message(FATAL_ERROR "the unit starts no teletact-service")
endif()
run(${C_COMPILER} -shared -fPIC -Wall -Werror -I ${FOLDER}/dev/include
  -o ${FOLDER}/device.so ${FOLDER}/dev/share/doc/teletact-dev/examples/template.c -lm)
file(GLOB contract ${FOLDER}/dev/share/teletact/proto/teletact/v1/*.proto)
run(${PROTOC} -I ${FOLDER}/dev/share/teletact/proto --descriptor_set_out=${FOLDER}/contract ${contract})
file(REMOVE_RECURSE ${FOLDER})
