# TARSIER_PYTHON3: the Python interpreter of the test scripts, or empty. If python3 is the shim of a version manager,
# this is the interpreter behind it, since the shim takes more time than most scripts.
find_program(TARSIER_PYTHON3_COMMAND python3)
set(TARSIER_PYTHON3 "")
if(TARSIER_PYTHON3_COMMAND)
  execute_process(COMMAND ${TARSIER_PYTHON3_COMMAND} -c "import sys; print(sys.executable)"
    OUTPUT_VARIABLE TARSIER_PYTHON3 OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
if(TARSIER_PYTHON3)
  cmake_path(GET TARSIER_PYTHON3 PARENT_PATH folder)
  list(APPEND TARSIER_TEST_ENVIRONMENT "TARSIER_TEST_PYTHON=${folder}")
endif()
