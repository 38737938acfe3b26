// Open this in the Arduino IDE, choose the board Uno and upload it. The other files must be in the same folder.
extern "C" void board_begin(void);
extern "C" void board_loop(void);

void setup() { board_begin(); }

void loop() { board_loop(); }
