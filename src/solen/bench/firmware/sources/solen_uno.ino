// Open this in the Arduino IDE, choose the board Uno and upload it. All the rest is in the files beside it.
extern "C" void board_begin(void);
extern "C" void board_turn(void);

void setup() { board_begin(); }

void loop() { board_turn(); }
