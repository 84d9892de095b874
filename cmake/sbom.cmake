# What CPack runs when all components are staged: each gets a list of what it is made of.
list(GET CPACK_BUILD_SOURCE_DIRS 0 source)
list(GET CPACK_BUILD_SOURCE_DIRS 1 build)
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} upper)
  set(architecture ${CPACK_DEBIAN_${upper}_PACKAGE_ARCHITECTURE})
  if(NOT architecture)
    set(architecture ${CPACK_DEBIAN_PACKAGE_ARCHITECTURE})
  endif()
  execute_process(COMMAND ${source}/packaging/debian/sbom.py ${CPACK_TEMPORARY_DIRECTORY}/${component} --build ${build}
    --package teletact-${component} --version ${CPACK_PACKAGE_VERSION} "--architecture=${architecture}" COMMAND_ERROR_IS_FATAL ANY)
endforeach()
