# Installs what BUILD has built into FOLDER, each component into its own prefix, and tries what lies there: both
# binaries start, the unit can be read and its options are taken, the template of a device compiles, the contract is whole.
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
  list(FILTER files EXCLUDE REGEX "^(share/doc|lib/teletact)/")
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
string(REPLACE "ExecStart=teletact-service" "" options "${start} --device none-such")  # which ends it
separate_arguments(options UNIX_COMMAND "${options}")
execute_process(COMMAND ${FOLDER}/service/bin/teletact-service ${options} ERROR_VARIABLE said OUTPUT_VARIABLE ignored)
if(NOT said MATCHES "no OpenCL device")
  message(FATAL_ERROR "the unit's options are not taken:\n${said}")
endif()
find_program(SYSTEMD_ANALYZE systemd-analyze)
if(SYSTEMD_ANALYZE)
  run(${SYSTEMD_ANALYZE} verify --man=no --recursive-errors=no --root=${FOLDER}/service
    /lib/systemd/system/teletact.service)
else()
  message(STATUS "no systemd-analyze here: nobody has read the unit")
endif()
run(${C_COMPILER} -shared -fPIC -Wall -Werror -I ${FOLDER}/dev/include
  -o ${FOLDER}/device.so ${FOLDER}/dev/share/doc/teletact-dev/examples/template.c -lm)
file(GLOB contract ${FOLDER}/dev/share/teletact/proto/teletact/v1/*.proto)
run(${PROTOC} -I ${FOLDER}/dev/share/teletact/proto --descriptor_set_out=${FOLDER}/contract ${contract})
file(REMOVE_RECURSE ${FOLDER})
