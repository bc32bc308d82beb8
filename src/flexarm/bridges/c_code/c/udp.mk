
# A program that runs the controller as the partner of fa.realtime.
$(NAME)_udp: $(NAME)_udp.c $(NAME).o
	$(CC) $(CFLAGS) $(WARNINGS) -o $@ $(NAME)_udp.c $(NAME).o -lm

udp: $(NAME)_udp

.PHONY: udp
